#!/usr/bin/env bash
# Builds the solver for 64-bit ARM, on any machine and without a linker, and counts the vector
# instructions of its kernel: multiply-adds of two doubles, and the scalar ones of the way without NEON.
set -euo pipefail
cd "$(dirname "$0")/.."

target=aarch64-unknown-linux-gnu
rustup target add "$target"
cargo check --locked --target "$target" -p manduca-numerics
cargo rustc --locked --release --target "$target" -p manduca-numerics --lib -- --emit asm

folder=${CARGO_TARGET_DIR:-target}/$target/release/deps
assembly=$(ls -t "$folder"/manduca_numerics-*.s | head -1)
awk '
  /^[A-Za-z_$][A-Za-z0-9_.$]*:/ { kernel = $0 ~ /uvlm6kernel6induce/; if (kernel) found = 1 }
  kernel && /fml[as][ \t]+v[0-9]+\.2d/ { vector++ }
  kernel && /fn?m(add|sub)[ \t]+d/ { scalar++ }
  END {
    if (!found) { print "error: no kernel in the assembly" > "/dev/stderr"; exit 1 }
    printf "kernel: %d vector multiply-adds (fmla v.2d), %d scalar ones\n", vector, scalar
    exit !(vector > 0)
  }' "$assembly"
