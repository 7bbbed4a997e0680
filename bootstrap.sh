#!/usr/bin/env bash
# Sets up .venv beside this file with the package and the extras named: `bash bootstrap.sh [EXTRA ...]`.
set -euo pipefail
cd "$(dirname "$0")"

# Drake's wheel needs one system library that a minimal Debian or Ubuntu lacks.
if command -v ldconfig >/dev/null && ! ldconfig -p | grep -q 'libglib-2.0.so.0' && command -v apt-get >/dev/null; then
  as_root=""
  [ "$(id -u)" -eq 0 ] || as_root="sudo"
  $as_root apt-get update -qq
  $as_root apt-get install -y -qq libglib2.0-0
fi

[ -x .venv/bin/python ] || "${PYTHON:-python3}" -m venv .venv
extras=$(IFS=,; echo "$*")
.venv/bin/python -m pip install --quiet --editable ".${extras:+[$extras]}"
