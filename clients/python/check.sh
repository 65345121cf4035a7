#!/usr/bin/env bash
# Types, style and behaviour of the Python client, in a virtual environment of its own.
# MANDUCA names the binary to test against; without it target/release, target/debug, then PATH.
set -euo pipefail
if [ -n "${MANDUCA:-}" ]; then MANDUCA=$(realpath "$MANDUCA") && export MANDUCA; fi
cd "$(dirname "$0")"

[ -x .venv/bin/pip ] || python3 -m venv .venv
.venv/bin/pip install --quiet --no-compile --editable '.[test]'

.venv/bin/ruff format --check
.venv/bin/ruff check
.venv/bin/mypy
.venv/bin/pytest "$@"
