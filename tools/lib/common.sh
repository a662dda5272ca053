# Shared by the commands in tools/. Sourced by bash, not run.
# shellcheck shell=bash

# Exit status of every command of the project.
readonly EXIT_USAGE=1       # wrong options or configuration
readonly EXIT_AIM=3         # ran, but did not reach its aim
readonly EXIT_MACHINE=4     # the machine lacks something
export EXIT_USAGE EXIT_AIM EXIT_MACHINE

say() { printf '%s\n' "$*"; }

# die STATUS MESSAGE...
die() {
    local status=$1
    shift
    printf '%s: %s\n' "${0##*/}" "$*" >&2
    exit "$status"
}

# quietly LOG TITLE COMMAND...: runs COMMAND with its output in LOG. Prints the title and the time it took, on a
# terminal also the last line of progress; when the command fails, the end of the log and its name.
quietly() {
    local log=$1 title=$2 start=$SECONDS status=0 line
    shift 2
    mkdir -p "$(dirname "$log")"
    if [ -t 1 ]; then
        "$@" 2>&1 | tee "$log" | while IFS= read -r line; do
            printf '\r\033[K%s: %.60s' "$title" "$line"
        done || status=$?
        printf '\r\033[K'
    else
        printf '%s ...\n' "$title"
        "$@" >"$log" 2>&1 || status=$?
    fi
    if [ "$status" -ne 0 ]; then
        tail -n 80 "$log" >&2
        printf '%s: failed after %d s; the whole log is %s\n' "$title" "$((SECONDS - start))" "$log" >&2
        return "$status"
    fi
    printf '%s: %d s\n' "$title" "$((SECONDS - start))"
}
