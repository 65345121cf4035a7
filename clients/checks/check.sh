#!/usr/bin/env bash
# What is written for other programs, read by them: the wake by VTK, the surrogate by
# onnxruntime, the dataset by Arrow; and the REST interface held against its own document by
# schemathesis. In a virtual environment of its own, against a coordinator and a worker of its own.
# MANDUCA names the binary; without it target/release, target/debug, then PATH.
set -euo pipefail
if [ -n "${MANDUCA:-}" ]; then MANDUCA=$(realpath "$MANDUCA"); fi
cd "$(dirname "$0")"
for built in ../../target/release/manduca ../../target/debug/manduca; do
  if [ -z "${MANDUCA:-}" ] && [ -x "$built" ]; then MANDUCA=$(realpath "$built"); fi
done
binary=${MANDUCA:-manduca}
# Settings of the developer's are not for checks.
for name in $(compgen -e | grep '^MANDUCA' || true); do unset "$name"; done

[ -x .venv/bin/pip ] || python3 -m venv .venv
.venv/bin/pip install --quiet --no-compile --disable-pip-version-check -r requirements.txt

folder=$(mktemp -d)
started=()
finish() {
  # The worker, started last, first: it delivers what it has.
  for ((i = ${#started[@]} - 1; i >= 0; i--)); do
    kill "${started[i]}" 2>/dev/null || true
    wait "${started[i]}" 2>/dev/null || true
  done
  rm -rf "$folder"
}
trap finish EXIT

port=$(python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
export MANDUCA_COORDINATOR=http://127.0.0.1:$port
"$binary" serve --listen "127.0.0.1:$port" --data "$folder/data" 2>"$folder/serve.log" &
started+=($!)
for _ in $(seq 100); do
  "$binary" healthcheck --url "$MANDUCA_COORDINATOR/readyz" 2>/dev/null && break
  kill -0 "${started[0]}" 2>/dev/null || { cat "$folder/serve.log"; exit 1; }
  sleep 0.2
done
"$binary" worker --slots 2 2>"$folder/worker.log" &
started+=($!)

step() { printf '== %s (%ss)\n' "$1" "$SECONDS"; }

step "a study of blade elements"
"$binary" -q study submit study.json --wait --json >"$folder/answer.json"

step "VTK reads the wake"
"$binary" -q simulate --vtk "$folder/flight" --wake "$folder/wake.json" --wake-steps all --strokes 3 --strokes-most 3 \
  --strokes-dropped 1 --steps-per-stroke 24 --chordwise-panels 4 --spanwise-panels 6 >/dev/null
.venv/bin/python read_vtk.py "$folder/flight/flight.pvd" "$folder/wake.json"

step "onnxruntime predicts what the coordinator predicts"
"$binary" -q study model latest -o "$folder/net.onnx"
.venv/bin/python run_onnx.py "$folder/net.onnx" "$MANDUCA_COORDINATOR"

step "Arrow reads the dataset"
"$binary" -q dataset latest -o "$folder/samples.parquet"
"$binary" -q dataset latest -o "$folder/samples.csv"
.venv/bin/python read_parquet.py "$folder/samples.parquet" "$folder/samples.csv"

# Nobody computes what it will submit.
kill "${started[1]}" && wait "${started[1]}" 2>/dev/null || true
study=$("$binary" study show latest --json | sed -n 's/^  "id": "\(.*\)",$/\1/p')
export STUDY=$study
step "the REST interface is what its document says"
.venv/bin/schemathesis --config-file schemathesis.toml run "$MANDUCA_COORDINATOR/openapi.json" ||
  { tail -n 20 "$folder/serve.log"; exit 1; }
if grep -q "failed inside the coordinator" "$folder/serve.log"; then
  cat "$folder/serve.log"
  exit 1
fi
step "done"
