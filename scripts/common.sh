# What the scripts share; sourced, not run.

# Says what is being done.
say() { printf '\n== %s\n' "$*" >&2; }

# Ends with one sentence.
give_up() {
    printf '%s: %s\n' "$(basename "$0")" "$*" >&2
    exit 1
}

# Names what is missing on this machine, with the command that installs it.
need_tools() {
    command -v cargo >/dev/null || give_up "cargo is missing: install the Rust toolchain from https://rustup.rs"
    command -v cc >/dev/null || give_up "a C compiler is missing: apt-get install gcc libc6-dev"
    command -v python3 >/dev/null || give_up "python3 is missing: apt-get install python3 python3-venv"
}

# Makes .venv with the independent readers and the drives' own client, which the tests compare with.
need_python_packages() {
    local wanted=tests/python/requirements.txt stamp=.venv/.requirements.txt
    if cmp -s "$wanted" "$stamp"; then
        return
    fi
    say "making .venv with the Python packages of $wanted"
    # Root's tests run as another user, who cannot enter a Python in root's home.
    local python=python3
    if [ "$(id -u)" -eq 0 ] && [ -x /usr/bin/python3 ]; then python=/usr/bin/python3; fi
    "$python" -m venv --clear .venv || give_up "python3 cannot make a virtual environment: apt-get install python3-venv"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check -r "$wanted" ||
        give_up "the packages of $wanted could not be installed: is the network there? Or set NIMS_PYTHON to a Python that has them"
    cp "$wanted" "$stamp"
}

# Gets the readers of Foxglove and Lichtblick, which some tests compare with; without JavaScript on this machine these
# comparisons are left out, which is said again at the end.
need_node_packages() {
    local wanted=tests/node/package-lock.json stamp=tests/node/node_modules/.package-lock.nims
    if cmp -s "$wanted" "$stamp"; then
        return
    fi
    if ! command -v npm >/dev/null || ! command -v node >/dev/null; then
        without_node "there is no node or no npm here"
        return
    fi
    say "getting the JavaScript packages of $wanted"
    npm ci --silent --no-fund --no-audit --prefix tests/node || { without_node "the packages of $wanted could not be installed"; return; }
    cp "$wanted" "$stamp"
}

# Tests look at this variable, and fail where it is not set and the readers are not there.
without_node() {
    export NIMS_WITHOUT_NODE=1
    say "WARNING: $1: run files are NOT compared with what JavaScript reads in them"
}

# All tests but the examples in the documentation; nextest takes half the time, because tests of several files run at once.
run_tests() {
    if cargo nextest --version >/dev/null 2>&1; then
        cargo nextest run "$@"
    else
        cargo test --no-fail-fast --lib --bins --tests "$@"
    fi
}

# From here on cargo starts test programs as the user nobody; only root needs that, and can do it. Programs have to be built already. The
# variable that says so to cargo is named by RUNNER.
run_tests_as_nobody() {
    command -v setpriv >/dev/null || give_up "root needs setpriv to run the tests as another user: apt-get install util-linux"
    export NIMS_TEST_HOME
    NIMS_TEST_HOME=$(mktemp -d /tmp/nims-test.XXXXXX)
    chown nobody "$NIMS_TEST_HOME"
    trap 'rm -rf "$NIMS_TEST_HOME"' EXIT
    can_read() { scripts/run-unprivileged test -r "$PWD/Cargo.toml" -a -x "${CARGO_TARGET_DIR:-$PWD/target}/debug"; }
    if ! can_read 2>/dev/null; then
        # A folder that only root can enter: nobody gets the right to read everything, and nothing else.
        export NIMS_READ_ALL=1
        can_read ||
            give_up "the user nobody cannot read $PWD, and tests do not run as root: put the project where others can read it (/srv, /opt, /tmp)"
    fi
    local triple
    triple=$(rustc -vV | sed -n 's/^host: //p' | tr 'a-z-' 'A-Z_')
    RUNNER="CARGO_TARGET_${triple}_RUNNER"
    export "$RUNNER=$PWD/scripts/run-unprivileged"
}
