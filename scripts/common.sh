# shellcheck shell=bash
# What the scripts share; sourced, not run.

# Reports a step.
say() {
    printf '\n== %s\n' "$*" >&2
    [ -z "${STEP:-}" ] || printf '%s %s\n' "$SECONDS" "$*" >"$STEP"
}

# Shows that long steps go on: cargo's own lines and bar to a terminal, and elsewhere a line every ten seconds, with the
# step and its time so far. Sets QUIET for cargo. `tidy` ends it.
begin_progress() {
    QUIET=()
    [ ! -t 2 ] || return 0
    QUIET=(--quiet)
    STEP=$(mktemp /tmp/nims-step.XXXXXX)
    {
        exec {never}<> <(:)
        # Waits without a further process, which would outlive this one.
        while read -r -t 10 -u "$never" || [ -e "$STEP" ]; do
            if read -r since name <"$STEP"; then printf '   %s: %s s\n' "$name" "$((SECONDS - since))" >&2; fi
        done
    } &
    TICKER=$!
}

# Ends with one sentence.
give_up() {
    printf '%s: %s\n' "$(basename "$0")" "$*" >&2
    exit 1
}

# Prints the version, which names a folder and a package: between two releases it carries the date of its commit, so
# that later ones sort behind earlier ones, and the commit.
nims_version() {
    local version commit
    # Root reads the checkout of a user, whose scripts it runs.
    local git=(git -c "safe.directory=$PWD")
    version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
    if commit=$(TZ=UTC "${git[@]}" log -1 --date=format-local:%Y%m%d%H%M%S --format=%cd.%h --abbrev=10 2>/dev/null); then
        version=$version+$commit
        "${git[@]}" diff --quiet HEAD || version=$version.dirty
    fi
    echo "$version"
}

# Notes the version of a part that its own script has built, beside it: the program $2 in folder $1.
note_version() { nims_version >"$1/$2.version"; }

# Refuses a part of another version than $4: gateway, page and live view of one version understand each other, and no
# others. $3 is its script.
need_version() {
    [ "$(cat "$1/$2.version" 2>/dev/null)" = "$4" ] ||
        give_up "$1/$2 is not of this version: build it again with $3 --release, or remove it"
}

# Prints what `--version` of a program of version $1 ends with; see shared/runtime/runtime/build.rs.
stated_version() {
    local commit=""
    case $1 in *+*) commit=${1#*+}; commit=${commit#*.} ;; esac
    commit=${NIMS_COMMIT:-${commit/.dirty/-dirty}}
    echo "${1%%+*} release${commit:+ $commit}"
}

# Refuses programs of another version than $1: processes of one version understand each other, and no others. $2 is
# their folder, $3 their names; further words run a program. One that is missing is the matter of `put_files`.
need_programs() {
    local version=$1 bin=$2 names=$3 wanted program said
    shift 3
    wanted=$(stated_version "$version")
    for program in $names; do
        [ -e "$bin/$program" ] || continue
        # A debug build states no commit.
        said=$("$@" "$bin/$program" --version 2>&1 </dev/null | head -n 1) || true
        case $said in
            *" $wanted") ;;
            *) give_up "$bin/$program is not of this version: it says \`$said\`, and this is $wanted; build it again" ;;
        esac
    done
}

# The programs of a list, as packages of the workspace.
programs_of() { sed -n 's|^[0-9]*[?k]* *@bin@/\([^ /*]*\) .*|\1|p' "$1"; }

# Prints one word as a shell reads it.
shell_word() { printf "'%s'" "${1//\'/\'\\\'\'}"; }

# Makes the man pages and completions in folder $2 with the built program $1/nims-manual; further words run it.
make_manual() {
    local bin=$1 made=$2
    shift 2
    "$@" "$bin/nims-manual" "$made" >/dev/null
    cp configs/host/*.[18] "$made/man/"
    gzip -9nf "$made"/man/*.[18]
}

# Prints the files of a pattern, or the pattern if there are none; folders may have spaces in their names.
matching() {
    local IFS=
    # shellcheck disable=SC2086  # the pattern
    printf '%s\n' $1
}

# Puts the files of the list $5 below $1, the programs in the folder $2; $3 has the built programs, $4 the made files.
# Everything is there before the first file is put.
put_files() {
    local root=$1 version=$2 bin=$3 made=$4 list=$5 put mode from to flag source sources name
    for put in "" yes; do
        while read -r mode from to; do
            case $mode in '' | '#'*) continue ;; esac
            flag=${mode#0???} mode=${mode%[?k]}
            from=${from/@bin@/$bin} from=${from/@made@/$made} to=${to/@version@/$version}
            mapfile -t sources < <(matching "$from")
            for source in "${sources[@]}"; do
                if [ ! -e "$source" ]; then
                    [ "$flag" = "?" ] || give_up "$source is missing: build it with cargo build --release --workspace --bins"
                    continue
                fi
                name=$to
                case $to in */) name=$to$(basename "$source") ;; esac
                if [ -z "$put" ] || { [ "$flag" = k ] && [ -e "$root$name" ]; }; then continue; fi
                install -D -m "$mode" "$source" "$root$name"
            done
        done <"$list"
    done
}

# The commands of the current version, as links.
COMMANDS=(/usr/bin/nims /usr/bin/nims-at /usr/sbin/nims-version)
put_links() { # below a root
    local command
    for command in "${COMMANDS[@]}"; do
        mkdir -p "$1$(dirname "$command")"
        ln -sfn "/opt/nims/current/bin/$(basename "$command")" "$1$command"
    done
}

# Prints the path of each file of all lists that `put_files` may have put outside the folder of a version.
named_files() {
    local mode from to source
    cat configs/host/files configs/host/files-* | while read -r mode from to; do
        case $mode in '' | '#'* | *k) continue ;; esac
        case $to in @version@*) continue ;; */) ;; *) echo "$to"; continue ;; esac
        case $from in @made@*) continue ;; esac
        for source in $from; do echo "$to$(basename "$source")"; done
    done
}

# Whether version $1 is at least $2.
at_least() { [ "$(printf '%s\n%s\n' "$2" "$1" | sort -V | head -n 1)" = "$2" ]; }

# Checks the tools of this machine and their versions; names the command that installs or updates one.
need_tools() {
    local oldest found tool
    for tool in cargo rustc; do
        command -v $tool >/dev/null || give_up "$tool is missing: install the Rust toolchain from https://rustup.rs"
    done
    oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    found=$(rustc --version | cut -d ' ' -f 2)
    at_least "$found" "$oldest" ||
        give_up "Rust is $found here, and $oldest or later is needed: rustup update, or install it from https://rustup.rs"
    command -v cc >/dev/null || give_up "a C compiler is missing: apt-get install gcc libc6-dev"
}

# Checks Python, which only tests and some scripts need.
need_python_itself() {
    local found
    command -v python3 >/dev/null || give_up "python3 is missing: apt-get install python3 python3-venv"
    found=$(python3 -c 'import platform; print(platform.python_version())')
    at_least "$found" 3.11 || give_up "Python is $found here, and 3.11 or later is needed: apt-get install python3"
}

# Makes .venv with the independent readers and the drives' own client, which the tests compare with, and with linters.
need_python_packages() {
    local wanted=tests/python/requirements.txt stamp=.venv/.requirements.txt
    if cmp -s "$wanted" "$stamp"; then
        return
    fi
    need_python_itself
    say "making .venv with the Python packages of $wanted"
    # Root's tests run as another user, who cannot enter a Python in root's home.
    local python=python3
    if [ "$(id -u)" -eq 0 ] && [ -x /usr/bin/python3 ]; then python=/usr/bin/python3; fi
    "$python" -m venv --clear .venv || give_up "python3 cannot make a virtual environment: apt-get install python3-venv"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check -r "$wanted" ||
        give_up "the packages of $wanted could not be installed: is the network there? Or set NIMS_PYTHON to a Python that has them"
    cp "$wanted" "$stamp"
}

# Begins to make .venv, which takes twenty seconds of one processor and waits for network and disk. `need_python` waits
# for it, and `tidy` ends it.
begin_python() {
    if [ -n "${NIMS_PYTHON:-}" ] || cmp -s tests/python/requirements.txt .venv/.requirements.txt; then return; fi
    need_python_itself
    # A group of its own, so that it ends with its children.
    set -m
    need_python_packages </dev/null &
    PYTHON_MAKER=$!
    set +m
}

# Sets NIMS_PYTHON, unless it is set already.
need_python() {
    if [ -n "${PYTHON_MAKER:-}" ]; then
        wait "$PYTHON_MAKER" || give_up "the Python packages could not be made: the reason stands above"
        PYTHON_MAKER=
    fi
    if [ -n "${NIMS_PYTHON:-}" ]; then
        say "using $NIMS_PYTHON"
    else
        need_python_packages
        export NIMS_PYTHON="$PWD/.venv/bin/python"
    fi
}

# Gets the readers of Foxglove and Lichtblick, which some tests compare with. Without JavaScript on this machine these
# comparisons are left out, which is reported at the end.
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

# Tests read this variable; without it they fail where the readers are missing.
without_node() {
    export NIMS_WITHOUT_NODE=1
    say "WARNING: $1: run files are NOT compared with what JavaScript reads in them"
}

# The path of a program of tests/python/requirements.txt: beside $NIMS_PYTHON, or of this machine.
tool() {
    local beside
    beside=$(dirname "$NIMS_PYTHON")/$1
    if [ -x "$beside" ]; then echo "$beside"; return; fi
    command -v "$1" || give_up "$1 is missing beside $NIMS_PYTHON: install tests/python/requirements.txt there"
}

# Begins the notes of this run: what is left out and what is repeated. Tests append to the file, see the crate `notes`.
begin_notes() {
    NOTES=$(mktemp -d /tmp/nims-notes.XXXXXX)
    export NIMS_TEST_NOTES="$NOTES/notes"
    : >"$NIMS_TEST_NOTES"
    # tests run as another user
    chmod 711 "$NOTES"
    chmod 666 "$NIMS_TEST_NOTES"
}

# Notes a check that is left out, and why.
leave_out() { printf 'left out\t%s\t%s\n' "$1" "$2" >>"$NIMS_TEST_NOTES"; }

# Notes the tests that are only run by hand.
note_ignored_tests() {
    local file rest
    while IFS=: read -r file rest; do
        rest=${rest#*ignore = \"}
        leave_out "an ignored test of $file" "${rest%%\"*}"
    done < <(git grep '#\[ignore = ' -- '*.rs')
}

# Prints the notes. More repeated live tests than a quiet machine needs are an error: either the machine was too busy
# for this run to prove anything, or a test depends on luck.
show_notes() {
    local kind count permitted=3
    for kind in "left out" "repeated"; do
        count=$(grep -c "^$kind" "$NIMS_TEST_NOTES" || true)
        [ "$count" -gt 0 ] || continue
        say "$kind: $count"
        sed -n "s/^$kind\t\([^\t]*\)\t/    \1: /p" "$NIMS_TEST_NOTES" | sort -u >&2
    done
    [ "$count" -le "$permitted" ] ||
        give_up "$count live tests were repeated, and a quiet machine needs at most $permitted: see above what the machine did meanwhile, and run this again when nothing else runs"
}

# Sets LINT_WITH to the oldest toolchain that is promised, `rust-version`: linting everything with it also proves that
# it compiles everything. Where rustup cannot provide it, the present toolchain lints; its lint incompatible_msrv then
# finds what the standard library of the oldest lacks.
need_oldest_toolchain() {
    local oldest
    LINT_WITH=()
    oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    if cargo "+$oldest" clippy --version >/dev/null 2>&1 || timeout 90 \
        rustup toolchain install "$oldest" --profile minimal --component clippy --no-self-update >/dev/null 2>&1; then
        LINT_WITH=("+$oldest")
    else
        leave_out "a build with the oldest toolchain, $oldest" "it is not here and rustup cannot install it"
    fi
}

# Shell and Python: ruff and shellcheck, on every script.
lint_scripts() {
    local python shell ruff shellcheck
    ruff=$(tool ruff)
    shellcheck=$(tool shellcheck)
    python=$(git ls-files '*.py'; git grep -lI '^#!.*python' -- scripts configs .ci)
    shell=$(git ls-files '*.sh'; git grep -lIE '^#!.*(bash|/sh)$' -- scripts configs .ci)
    # shellcheck disable=SC2086  # lists of files without spaces
    "$ruff" check --quiet --config .config/ruff.toml --cache-dir "${CARGO_TARGET_DIR:-target}/ruff" $python
    # shellcheck disable=SC2086
    "$shellcheck" --external-sources $shell
}

# Licences, banned and duplicate versions, and sources of all dependencies, by deny.toml; known vulnerabilities where
# their database is on this machine.
check_dependencies() {
    local deny workspace
    deny=$(tool cargo-deny)
    deny() { "$deny" --log-level error --config "$PWD/deny.toml" "$@"; }
    deny check --hide-inclusion-graph bans licenses sources
    for workspace in services/page services/viewer tests/benchmarks tests/peers; do
        deny --all-features --manifest-path $workspace/Cargo.toml check --hide-inclusion-graph licenses sources
    done
    # A download that failed leaves a folder without content.
    if compgen -G "${CARGO_HOME:-$HOME/.cargo}/advisory-dbs/*/.git/HEAD" >/dev/null; then
        deny --offline check --hide-inclusion-graph advisories
    else
        leave_out "known vulnerabilities of dependencies" "their database is not here: cargo-deny fetch"
    fi
}

# The documentation, with every link in it; with the toolchain of the lints, which has checked the dependencies already.
check_links() {
    RUSTDOCFLAGS="-D warnings" cargo "${LINT_WITH[@]}" doc "${QUIET[@]}" --no-deps --workspace --document-private-items
}

# The workspaces beside the main one: their format, and that their lock files are those of their manifests. What they
# bring along (servers of web pages and WebSockets, the peers of the benchmarks) is compiled by their own scripts only.
check_separate_workspaces() {
    local workspace
    for workspace in services/page services/viewer tests/benchmarks tests/peers; do
        cargo fmt --manifest-path $workspace/Cargo.toml --check
        cargo metadata --locked --format-version 1 --manifest-path $workspace/Cargo.toml >/dev/null ||
            give_up "$workspace/Cargo.lock is older than the manifests: run its script (scripts/page, scripts/viewer or scripts/bench), and add the lock file"
    done
}

# All tests but the examples in the documentation. nextest takes half the time, because tests of several files run at
# once.
run_tests() {
    if cargo nextest --version >/dev/null 2>&1; then
        cargo nextest run "$@"
    else
        cargo test --no-fail-fast --tests "$@"
    fi
}

# From here on cargo starts test programs as the user nobody. Only root needs that, and can do it. Programs have to be
# built already. RUNNER is the name of the variable that tells cargo so.
run_tests_as_nobody() {
    command -v setpriv >/dev/null || give_up "root needs setpriv to run the tests as another user: apt-get install util-linux"
    export NIMS_TEST_HOME
    NIMS_TEST_HOME=$(mktemp -d /tmp/nims-test.XXXXXX)
    chown nobody "$NIMS_TEST_HOME"
    can_read() { scripts/run-unprivileged test -r "$PWD/Cargo.toml" -a -x "${CARGO_TARGET_DIR:-$PWD/target}/debug"; }
    if ! can_read 2>/dev/null; then
        # A folder that only root can enter: the tests get the right to read everything, and nothing else.
        export NIMS_READ_ALL=1
        can_read ||
            give_up "the user nobody cannot read $PWD, and tests do not run as root: put the project where others can read it (/srv, /opt, /tmp)"
    fi
    local triple
    triple=$(rustc -vV | sed -n 's/^host: //p' | tr 'a-z-' 'A-Z_')
    RUNNER="CARGO_TARGET_${triple}_RUNNER"
    export "$RUNNER=$PWD/scripts/run-unprivileged"
}

# Removes the temporary folders of a test run, and ends its progress.
tidy() {
    rm -rf ${NIMS_TEST_HOME:+"$NIMS_TEST_HOME"} ${NOTES:+"$NOTES"} ${STEP:+"$STEP"}
    [ -z "${TICKER:-}" ] || kill "$TICKER" 2>/dev/null || true
    [ -z "${PYTHON_MAKER:-}" ] || kill -- "-$PYTHON_MAKER" 2>/dev/null || true
}
