#!/usr/bin/env bash
# Checks the unit, sysusers and tmpfiles files where systemd's tools are there; says so where they are not.
set -euo pipefail
cd "$(dirname "$0")"
if ! command -v systemd-analyze >/dev/null; then
    echo "systemd-analyze is not here; the unit is not checked"
    exit 0
fi
name=dual-pressure-controller.service
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# verify wants the program and its manual page to be there, and returns 0 on unknown keys: any output about the unit is
# a failure.
sed -e 's|^ExecStart=/usr/bin/controller|ExecStart=/bin/true|' -e 's|man:controller(1) ||' "$name" > "$scratch/$name"
said=$(systemd-analyze verify "$scratch/$name" 2>&1 | grep -F "$name" || true)
if [ -n "$said" ]; then
    echo "$said" >&2
    exit 1
fi
# Exposure at most 1.5 of 10: what is left is the network, real time, and system calls for priorities.
if ! systemd-analyze security --offline=true --threshold=15 --no-pager "$scratch/$name" > "$scratch/exposure" 2>&1; then
    cat "$scratch/exposure" >&2
    echo "$name: more exposed than 1.5" >&2
    exit 1
fi
grep -F "Overall exposure" "$scratch/exposure"
# Both are read in a root of their own, so that nothing here is changed.
mkdir -p "$scratch/root/etc"
if command -v systemd-sysusers >/dev/null; then
    systemd-sysusers --root="$scratch/root" "$PWD/dual-pressure.sysusers" >/dev/null
    grep -q '^dual-pressure:' "$scratch/root/etc/passwd"
    if command -v systemd-tmpfiles >/dev/null && [ "$(id -u)" = 0 ]; then
        systemd-tmpfiles --root="$scratch/root" --create "$PWD/dual-pressure.tmpfiles"
        [ -d "$scratch/root/var/lib/dual-pressure/recordings" ]
        # The sockets' folder, which the package has made at its installation.
        [ -d "$scratch/root/run/dual-pressure" ]
    fi
fi
echo "$name, sysusers, tmpfiles: sound"
