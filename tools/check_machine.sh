#!/usr/bin/env bash
# Is this machine able to build the environment? One clear line on standard error if not.
#   tools/check_machine.sh PYTHON
set -euo pipefail
python=$1

fail() {
    echo "make env: $*" >&2
    exit 1
}

suitable() {
    command -v "$1" >/dev/null && "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' >/dev/null 2>&1
}

other() {
    for name in python3.12 python3.13 python3.11 python3.10; do
        if suitable "$name"; then echo "make env PYTHON=$name"; return; fi
    done
    echo "install one, then: make env PYTHON=/path/to/python3.12"
}

command -v "$python" >/dev/null || fail "'$python' was not found; the ROS 2 wheels need Python 3.10 to 3.13; $(other)"
suitable "$python" || fail "'$python' is $("$python" --version 2>&1 | tail -n 1); the ROS 2 wheels need Python 3.10 to 3.13; $(other)"
"$python" -c 'import ensurepip, venv' 2>/dev/null ||
    fail "'$python' cannot make virtual environments; install its venv module (Debian, Ubuntu: apt install python3-venv)"
"$python" -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(sysconfig.get_path("include") + "/Python.h"))' ||
    fail "'$python' has no Python.h, which the messages are compiled with; install it (Debian, Ubuntu: apt install python3-dev)"
{ command -v "${CXX:-c++}" && command -v "${CC:-cc}"; } >/dev/null ||
    fail "no C and C++ compiler was found, which the messages are compiled with; install them (Debian, Ubuntu: apt install g++)"
