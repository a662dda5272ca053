# Installs Debian packages: says what and how much first, never removes one, never adds an architecture.
# Sourced by bash after common.sh.
# shellcheck shell=bash

# package_names FILE...: the names in package lists.
package_names() {
    sed -e 's/#.*//' -e 's/[[:space:]]//g' -e '/^$/d' "$@" | sort -u
}

# missing_packages NAME...: those of the names that are not installed.
missing_packages() {
    local name
    for name in "$@"; do
        [ "$(dpkg-query -W -f='${db:Status-Status}' "$name" 2>/dev/null)" = installed ] || printf '%s\n' "$name"
    done
}

APT_INSTALL=(apt-get install --no-remove -y --no-install-recommends)

# apt_plan NAME...: apt's own words on download and disk size. Fails when apt does not know a package. Needs no root.
apt_plan() {
    local plan
    plan=$(LC_ALL=C apt-get install --no-remove --no-install-recommends --assume-no \
        -o Debug::NoLocking=true "$@" 2>&1) || true
    printf '%s\n' "$plan" | grep -E '^(Need to get|After this operation)' | sed 's/^/  /'
}

# say_plan NAME...: what apt_plan says; while there are no package lists, what the lists' own estimates say.
# Reads PACKAGE_LISTS.
say_plan() {
    apt_plan "$@" && return
    awk '/^# On a bare Debian 12:/ { download += $7; disk += $11 }
        END { printf "  At most about %d MB of archives, %d MB of disk space (more exactly after apt-get update).\n", download, disk }' \
        "${PACKAGE_LISTS[@]}"
}

# as_root COMMAND...: runs it with the privileges found by find_privilege.
as_root() {
    if [ "$PRIVILEGE" = sudo ]; then
        sudo -- "$@"
    else
        "$@"
    fi
}

# Sets PRIVILEGE to root, sudo or none. A sudo that would have to ask counts only at a terminal.
find_privilege() {
    if [ "$(id -u)" -eq 0 ]; then
        PRIVILEGE=root
    elif command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
        PRIVILEGE=sudo
    else
        PRIVILEGE=none
    fi
}

# confirm QUESTION: true when the user, or --yes, agrees.
confirm() {
    local answer
    [ "$ASSUME_YES" = yes ] && return 0
    read -r -p "$1 [Y/n] " answer
    case $answer in
        '' | y | Y | yes) return 0 ;;
        *) return 1 ;;
    esac
}

# install_packages LIST-FILE...: makes sure that every package of the lists is installed, or exits with
# EXIT_MACHINE after saying what to do. Reads ASSUME_YES (yes or no).
install_packages() {
    local wanted missing by_hand
    command -v apt-get >/dev/null ||
        die "$EXIT_MACHINE" "apt-get not found: this command knows Debian 12. Install the equivalents of $*, then use --no-install."
    mapfile -t wanted < <(package_names "$@")
    mapfile -t missing < <(missing_packages "${wanted[@]}")
    [ "${#missing[@]}" -gt 0 ] || return 0
    PACKAGE_LISTS=("$@")
    by_hand="apt-get update && ${APT_INSTALL[*]} ${missing[*]}"

    say "Not yet installed, ${#missing[@]} Debian packages: ${missing[*]}"
    find_privilege
    if [ "$PRIVILEGE" = none ]; then
        say_plan "${missing[@]}"
        say "Installing them needs root, and there is no sudo. Run this as root, then this command again:"
        say "  $by_hand"
        exit "$EXIT_MACHINE"
    fi
    if [ "$ASSUME_YES" != yes ] && [ ! -t 0 ]; then
        say_plan "${missing[@]}"
        say "There is no terminal to ask on. Run this command with --yes, or as root:"
        say "  $by_hand"
        exit "$EXIT_MACHINE"
    fi

    if ! apt_plan "${missing[@]}"; then
        say_plan "${missing[@]}"
        confirm "The package lists must be fetched first (apt-get update). Do that now?" ||
            die "$EXIT_MACHINE" "nothing installed"
        as_root apt-get update -q
        apt_plan "${missing[@]}" || die "$EXIT_MACHINE" "apt cannot install ${missing[*]}; ask: apt-get -s install ${missing[*]}"
    fi
    confirm "Install them with apt-get (nothing is removed)?" || die "$EXIT_MACHINE" "nothing installed"
    if ! apt_install "${missing[@]}"; then
        say "Once more with fresh package lists."
        as_root apt-get update -q
        apt_install "${missing[@]}" || die "$EXIT_MACHINE" "apt-get failed; by hand: $by_hand"
    fi
}

# No service of a package is started while it is installed: whoever wants to build or test wants no new daemon.
# Debian asks policy-rc.d; one that is there stays and decides.
apt_install() {
    as_root bash -c '
        policy=/usr/sbin/policy-rc.d
        if [ ! -e "$policy" ]; then
            trap "rm -f $policy" EXIT
            printf "#!/bin/sh\nexit 101\n" >"$policy"
            chmod 755 "$policy"
        fi
        "$@"' apt_install env DEBIAN_FRONTEND=noninteractive "${APT_INSTALL[@]}" -q -o DPkg::Lock::Timeout=120 \
        -o Dpkg::Use-Pty=0 "$@"
}
