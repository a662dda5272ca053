# bash completion for wheelwright and wheelwrightd: options and subcommands come from --help, so they are never out of date.
_wheelwright() {
    local cur prev words cword
    _init_completion || return
    local line=("${words[0]}") word names
    for word in "${words[@]:1:cword-1}"; do
        names=$("${line[@]}" --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/s/^  \([a-z-]*\) .*/\1/p')
        [[ " ${names//$'\n'/ } " == *" $word "* ]] && line+=("$word")
    done
    if [[ $cur == -* ]]; then
        names=$("${line[@]}" --help 2>/dev/null | grep -oE -- '--[a-z0-9-]+' | sort -u)
    else
        names=$("${line[@]}" --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/s/^  \([a-z-]*\) .*/\1/p')
    fi
    mapfile -t COMPREPLY < <(compgen -W "$names" -- "$cur")
    [[ $cur == -* || ${#COMPREPLY[@]} -gt 0 ]] || _filedir
} && complete -F _wheelwright wheelwright wheelwrightd
