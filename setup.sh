#!/bin/sh
# Makes the virtual environment and installs the package with its compiled parts into it.
# Uses apt only as root; otherwise says in one line what to install.
set -eu
python=$1
venv=$2

need() { # need COMMAND PACKAGE
    command -v "$1" >/dev/null 2>&1 && return 0
    install_or_say "$2"
}

install_or_say() {
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        echo "setup: installing $1"
        DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null 2>&1 || true
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$1" >/dev/null
    else
        echo "setup: please install '$1' (for example: sudo apt install $1), then run make again" >&2
        exit 1
    fi
}

need "$python" python3
need cc gcc
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "setup: phaselead needs Python 3.11 or newer, $python is $("$python" -V 2>&1); run make PYTHON=/path/to/python3.11" >&2
    exit 1
}
if [ ! -x "$venv/bin/python" ]; then
    "$python" -c 'import ensurepip, venv' 2>/dev/null || install_or_say python3-venv
    echo "setup: making $venv"
    "$python" -m venv "$venv"
fi
echo "setup: installing pinned packages and compiling"
log=$(mktemp)
pip="$venv/bin/python -m pip install --disable-pip-version-check -q"
{ $pip -r requirements.lock && $pip --no-build-isolation --no-deps -e .; } >"$log" 2>&1 || {
    cat "$log" >&2
    echo "setup: installing failed, see above; a network connection to a package index is needed once" >&2
    exit 1
}
rm -f "$log"
