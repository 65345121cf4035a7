#!/usr/bin/env bash
# The dashboard in a real browser: a study is submitted on the page, watched to its end and looked at.
# MANDUCA names the binary to test; without it target/release, target/debug, then PATH.
# CHROMIUM names the browser; without it chromium from PATH, installed on a Debian machine without one.
# SHOTS names a folder for screenshots; none are taken without it.
set -euo pipefail
if [ -n "${MANDUCA:-}" ]; then MANDUCA=$(realpath "$MANDUCA") && export MANDUCA; fi
if [ -n "${SHOTS:-}" ]; then mkdir -p "$SHOTS" && SHOTS=$(realpath "$SHOTS") && export SHOTS; fi
cd "$(dirname "$0")"

if [ -z "${CHROMIUM:-}" ] && ! command -v chromium >/dev/null; then
  apt-get update && apt-get install -y --no-install-recommends chromium
fi
[ -x .venv/bin/pip ] || python3 -m venv .venv
.venv/bin/pip install --quiet --no-compile 'playwright>=1.50'
.venv/bin/python check.py
