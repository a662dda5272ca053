#compdef wheelwright wheelwrightd
# Options and subcommands come from --help, so they are never out of date.
local -a line names
local word
line=($words[1])
for word in ${words[2,CURRENT-1]}; do
    names=(${(f)"$($line --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/s/^  \([a-z-]*\) .*/\1/p')"})
    (( ${names[(Ie)$word]} )) && line+=($word)
done
if [[ $PREFIX == -* ]]; then
    names=(${(f)"$($line --help 2>/dev/null | grep -oE -- '--[a-z0-9-]+' | sort -u)"})
    compadd -- $names
else
    names=(${(f)"$($line --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/s/^  \([a-z-]*\) .*/\1/p')"})
    (( $#names )) && compadd -- $names || _files
fi
