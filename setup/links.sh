#!/bin/sh
# Make .venv-links hold what .venv holds, and what links and exports need besides: to try and to test them.
#
# An environment of its own: the packages of ROS 2 start every Python of theirs twice, to find their libraries.
# Safe to interrupt and to repeat; does nothing when up to date.
set -eu
cd "$(dirname "$0")/.."

venv=.venv-links
stamp=$venv/.complete
now=$(cat requirements.lock pyproject.toml setup/links.sh | cksum)
[ "$(cat $stamp 2>/dev/null)" = "$now" ] && exit 0

uv=uv
"$uv" --version >/dev/null 2>&1 || uv=.tools/bin/uv
printf 'Installing what links need into %s (600 MB beside what is there already) ...\n' "$venv" >&2
rm -f $stamp
[ -x $venv/bin/python ] || "$uv" venv --quiet --no-project --python .venv/bin/python $venv
"$uv" pip install --quiet --python $venv/bin/python --require-hashes --requirement requirements.lock
"$uv" pip install --quiet --python $venv/bin/python --no-build-isolation --constraint requirements.lock \
    --editable '.[export,ros2,mavlink]'
printf '%s' "$now" > $stamp
printf 'Now: source %s/bin/activate\n' "$venv" >&2
