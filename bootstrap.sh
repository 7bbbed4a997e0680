#!/usr/bin/env bash
# Sets up .venv beside this file with the package and the extras named: `bash bootstrap.sh [EXTRA ...]`.
set -euo pipefail
cd "$(dirname "$0")"

say() { printf 'bootstrap: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

extras=$(IFS=,; echo "$*")
python="${PYTHON:-python3}"
known=$(sed -n '/^\[project.optional/,/^\[tool/s/^\([a-z]*\) = \[.*/\1/p' pyproject.toml)
for extra in ${extras//,/ }; do
  grep -qxF -e "$extra" <<<"$known" || fail "there is no extra '$extra'; the extras are ${known//$'\n'/, }"
done

# An environment that exists keeps its Python, whatever the default one is.
[ -x .venv/bin/python ] && python=.venv/bin/python
command -v "$python" >/dev/null || fail "Python 3.10 to 3.13 is needed; there is no $python: set PYTHON=/path/to/python"
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
case "$version" in
  3.10 | 3.11 | 3.12 | 3.13) ;;
  *) fail "Python 3.10 to 3.13 is needed; $python is $version: set PYTHON=/path/to/python, and remove .venv" ;;
esac

# Drake's wheel needs one system library that a minimal Debian or Ubuntu lacks.
if command -v ldconfig >/dev/null && ! ldconfig -p | grep -q 'libglib-2.0.so.0' && command -v apt-get >/dev/null; then
  say "installing the system library libglib2.0-0, which Drake needs"
  as_root=""
  [ "$(id -u)" -eq 0 ] || as_root="sudo"
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq libglib2.0-0
fi

if [ ! -x .venv/bin/python ]; then
  say "making the environment .venv with Python $version"
  "$python" -m venv .venv || fail "venv failed: on Debian and Ubuntu, install python3-venv"
fi
say "installing lis_grasp${extras:+ with $extras}: 0.2 GB to download, 0.9 GB on disk, with extras more; a few minutes"
quiet=--quiet
[ ! -t 2 ] || quiet="" # a terminal shows the progress of pip
.venv/bin/python -m pip install $quiet --disable-pip-version-check --editable ".${extras:+[$extras]}"

say "done: $(.venv/bin/lis-grasp --version) in .venv; next:"
say "  .venv/bin/lis-grasp doctor                      # checks this machine"
say "  .venv/bin/lis-grasp run box --output results/demo  # about twenty seconds"
case ",$extras," in *,dev,*) say "  .venv/bin/python -m pytest                      # the tests" ;; esac
case ",$extras," in *,study,*) say "  .venv/bin/lis-grasp compare --quick             # a small study" ;; esac
case ",$extras," in *,docs,*) say "  .venv/bin/sphinx-build -W docs docs/_build/html # the documentation" ;; esac
