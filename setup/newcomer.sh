#!/bin/sh
# Walk a newcomer's path on a bare Debian: make demo, the README's five minutes, one notebook, the wheel.
# Usage: setup/newcomer.sh SUITE [STEP ...]      SUITE is bookworm (Debian 12) or trixie (Debian 13)
#
# Debian's base system is put into a folder by debootstrap, and everything runs in there, as an ordinary user, on a clone
# of what is committed here. It needs root, debootstrap (apt-get install debootstrap), the network, 8 GB of disk and, on
# two idle cores, about an hour for each suite. Steps: root packages setup demo readme notebook wheel, in this order;
# "tests" (make test) and "all-tests" (make test-all) only when they are named. A step that was done with the same commit is not
# done again, and the root never; each step has a log.
# NEWCOMER_HOME is where the roots go (/var/tmp/aerial-il-newcomer), NEWCOMER_MIRROR another mirror of Debian.
# Debian 12 has no Python 3.12, and uv fetches one from where it is published. Where that is out of reach, NEWCOMER_PYTHON
# is the folder of one that was built on a Debian 12 (~/.pyenv/versions/3.12.1, say): it is put into the root's /usr/local.
set -eu
cd "$(dirname "$0")/.."
HERE=$(pwd)
STEPS="root packages setup demo readme notebook wheel"
HOME_OF_ROOTS=${NEWCOMER_HOME:-/var/tmp/aerial-il-newcomer}

say() { echo "newcomer: $*" >&2; }
fail() { say "$*"; exit 2; }

suite=${1:-}
case $suite in
  bookworm | trixie) shift ;;
  *) fail "'$suite' is not a Debian that is tried: bookworm (12) or trixie (13), e.g. sudo setup/newcomer.sh trixie" ;;
esac
steps=${*:-$STEPS}
for step in $steps; do
  case " $STEPS tests all-tests " in
    *" $step "*) ;;
    *) fail "'$step' is not a step: $STEPS, and by name only: tests all-tests" ;;
  esac
done
[ "$(id -u)" = 0 ] || fail "must be started by root: it makes a root of its own.  sudo setup/newcomer.sh $suite"
command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"

base=$HOME_OF_ROOTS/$suite
root=$base/root
mkdir -p "$base/done" "$base/logs"

unmount() { for place in dev/pts dev/shm dev proc; do umount "$root/$place" 2>/dev/null || true; done; }
mount_all() {
  mount --bind /dev "$root/dev" && mount --bind /dev/pts "$root/dev/pts" && mount -t tmpfs tmpfs "$root/dev/shm" &&
    mount -t proc proc "$root/proc"
}
trap unmount EXIT

# How this machine reaches the network goes in with every command, if it says so; nothing else of it does.
NETWORK="http_proxy https_proxy all_proxy no_proxy HTTP_PROXY HTTPS_PROXY ALL_PROXY NO_PROXY SSL_CERT_FILE REQUESTS_CA_BUNDLE
  PIP_CERT PIP_INDEX_URL PIP_EXTRA_INDEX_URL PIP_DEFAULT_TIMEOUT
  UV_DEFAULT_INDEX UV_INDEX UV_INDEX_URL UV_EXTRA_INDEX_URL UV_NATIVE_TLS UV_HTTP_TIMEOUT UV_PYTHON_INSTALL_MIRROR"
enter() { # [NAME=VALUE ...] COMMAND [ARGUMENT ...]
  for name in $NETWORK; do
    eval "value=\${$name:-}"
    [ -z "$value" ] || set -- "$name=$value" "$@"
  done
  chroot "$root" /usr/bin/env -i "$@"
}
inside() { enter HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive sh -euc "$1"; }
newcomer() {
  enter HOME=/home/newcomer USER=newcomer PATH=/usr/local/bin:/usr/bin:/bin \
    setpriv --reuid newcomer --regid newcomer --init-groups sh -euc "cd /home/newcomer/aerial_il; $1"
}

# The files of the same kind: where names are looked up, which authorities are trusted, where pip and uv look.
bring_network() {
  cp -L /etc/resolv.conf "$root/etc/resolv.conf"
  mkdir -p "$root/usr/local/share/ca-certificates" "$root/etc/uv"
  bring "$root/usr/local/share/ca-certificates" /usr/local/share/ca-certificates/*.crt
  bring "$root/etc/pip.conf" /etc/pip.conf "$HOME/.config/pip/pip.conf"
  bring "$root/etc/uv/uv.toml" /etc/uv/uv.toml "$HOME/.config/uv/uv.toml"
}
bring() { # TARGET SOURCE ...: those that exist; of several for one file, the last
  target=$1
  shift
  for source in "$@"; do [ ! -e "$source" ] || cp -L "$source" "$target"; done
}

do_root() { debootstrap --variant=minbase "$suite" "$root" ${NEWCOMER_MIRROR:+"$NEWCOMER_MIRROR"}; }

do_packages() { # what the README asks for, and what an ordinary user cannot install later: libraries to draw with
  bring_network
  inside 'apt-get update -q
    apt-get install -y -q --no-install-recommends git make ca-certificates python3 python3-venv libegl1 libopengl0 libgl1-mesa-dri
    id newcomer >/dev/null 2>&1 || useradd --create-home --shell /bin/sh newcomer'
  rm -rf "$root/home/newcomer/aerial_il" "$root/tmp/aerial_il.bundle"
  git -c safe.directory="$HERE" bundle create "$root/tmp/aerial_il.bundle" HEAD
  inside 'git clone -q /tmp/aerial_il.bundle /home/newcomer/aerial_il && chown -R newcomer: /home/newcomer'
  [ -z "${NEWCOMER_PYTHON:-}" ] || bring_python
}

bring_python() {
  cp -a "$NEWCOMER_PYTHON/." "$root/usr/local/"
  inside 'ldconfig && /usr/local/bin/python3.12 -c "import ssl, ctypes"'
}

do_setup() { newcomer 'make setup'; }
do_demo() { newcomer 'make demo'; }

do_readme() { # its "Five minutes", with fewer flights
  newcomer '. .venv/bin/activate
    bash -euc "eval \"\$(aerial-il completion bash)\"; complete -p aerial-il"
    aerial-il list
    aerial-il collect robot=ua_quad_arm4 task=reach episodes=20 out=datasets/reach
    aerial-il validate datasets/reach
    aerial-il replay datasets/reach
    aerial-il convert datasets/reach
    aerial-il train dataset=datasets/reach algorithm.steps=500 run=runs/reach
    aerial-il evaluate policy=runs/reach episodes=20 out=runs/reach/calm
    aerial-il evaluate policy=expert robot=ua_quad_arm4 task=reach episodes=20 out=runs/expert
    aerial-il compare runs/expert runs/reach/calm
    aerial-il report runs/reach/calm run=runs/reach dataset=datasets/reach'
}

do_notebook() { newcomer 'make notebooks only=01 again=1'; }
do_wheel() { newcomer 'OMP_NUM_THREADS=1 .venv/bin/python -m pytest -q -m slow tests/project/test_wheel.py'; }
do_tests() { newcomer 'make test'; }
do_all_tests() { newcomer 'make test-all'; }

commit=$(git -c safe.directory="$HERE" rev-parse --short HEAD)
for step in $steps; do
  case $step in root) mark=$base/done/root ;; *) mark=$base/done/$step-$commit ;; esac
  if [ -e "$mark" ]; then
    say "$suite $step: done before, $(cat "$mark")"
    continue
  fi
  case $step in
    root) ;;
    *) unmount; mount_all || fail "this machine does not allow mounts, which a root of its own needs (a container? give it the capability SYS_ADMIN)." ;;
  esac
  begun=$(date +%s)
  function=do_$(echo "$step" | tr - _)
  # A subshell of its own: with "if" around it, set -e would not hold inside.
  set +e
  (set -e; "$function") > "$base/logs/$step.log" 2>&1
  status=$?
  set -e
  if [ $status != 0 ]; then
    tail -n 15 "$base/logs/$step.log" >&2
    say "$suite $step: FAILED after $(($(date +%s) - begun)) s, see $base/logs/$step.log; the same command goes on from there."
    exit 1
  fi
  echo "$(($(date +%s) - begun)) s" > "$mark"
  say "$suite $step: $(cat "$mark")"
done
