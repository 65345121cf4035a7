#!/usr/bin/env bash
# Checks the container image and docker-compose.yml with podman, as root: builds the image,
# brings up a coordinator and two workers, waits until all are healthy, runs the study `quick`
# on them, and takes everything down again.
#
#     sudo tests/container.sh                    # builds manduca in the image, as users do
#     sudo tests/container.sh --binary PATH      # puts this program in the image instead: minutes less
#
# Needs podman with runc and netavark, and podman-compose (from PyPI where it is not installed).
# Base images that no registry hands out are made with debootstrap from Debian's packages.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)

binary=
if [ "${1:-}" = --binary ]; then
  binary=$(realpath "${2:?--binary needs the path of a manduca program}")
fi

work=$(mktemp -d)
# Whatever the host's configuration is: no systemd is assumed, nothing outside `work` is touched.
cat >"$work/containers.conf" <<CONF
[network]
network_backend="netavark"
network_config_dir="$work/networks"
[engine]
cgroup_manager="cgroupfs"
events_logger="file"
runtime="runc"
[containers]
log_driver="k8s-file"
default_ulimits=["nofile=1024:4096","nproc=4096:4096"]
CONF
export CONTAINERS_CONF="$work/containers.conf"
cat >"$work/podman" <<PODMAN
#!/bin/sh
exec $(command -v podman) --storage-driver vfs --root "$work/store" --runroot "$work/run" "\$@"
PODMAN
chmod +x "$work/podman"
export PATH="$work:$PATH"

project=manduca-check
MANDUCA_TOKEN=$(od -An -N32 -tx1 /dev/urandom | tr -d ' \n')
export MANDUCA_TOKEN

compose() { "$composer" --project-name "$project" --file "$repository/docker-compose.yml" "$@"; }

clean() {
  status=$?
  if [ "$status" != 0 ]; then
    for container in $(podman ps --all --quiet 2>/dev/null); do
      echo "-- $(podman inspect --format '{{.Name}}: {{.State.Status}}' "$container")"
      podman logs --tail 20 "$container" 2>&1 || true
    done
  fi
  podman rm --all --force --time 5 >/dev/null 2>&1 || true
  podman network prune --force >/dev/null 2>&1 || true
  rm -rf "$work"
  exit "$status"
}
trap clean EXIT

step() { printf '== %s (%ss)\n' "$1" "$SECONDS"; }

composer=$(command -v podman-compose || true)
if [ -z "$composer" ]; then
  python3 -m venv "$work/venv"
  "$work/venv/bin/pip" install --quiet --disable-pip-version-check podman-compose==1.6.0
  composer="$work/venv/bin/podman-compose"
fi

# Makes Debian's base image where no registry can be asked for it.
base_image() {
  timeout 60 podman pull --quiet docker.io/library/debian:bookworm-slim >/dev/null 2>&1 && return
  debootstrap --variant=minbase bookworm "$work/base" >"$work/debootstrap.log" 2>&1 || {
    tail -5 "$work/debootstrap.log"
    return 1
  }
  tar -C "$work/base" -c . | podman import --quiet - docker.io/library/debian:bookworm-slim >/dev/null
  rm -rf "$work/base"
}

step "base image"
base_image

step "image"
arguments=(--network host --tag localhost/manduca)
if [ -n "$binary" ]; then
  # Stands for the stage that compiles: the rest of the Dockerfile is built as it is.
  mkdir -p "$work/build/src/target/release"
  cp "$binary" "$work/build/src/target/release/manduca"
  arguments+=(--build-context "build=$work/build")
fi
podman build "${arguments[@]}" "$repository" >"$work/build.log" 2>&1 || {
  tail -20 "$work/build.log"
  exit 1
}

containers() { podman ps --quiet --filter "label=com.docker.compose.service=$1"; }

# Waits until each container of a service is healthy. Without systemd nothing runs a container's
# health check at its interval: this does.
healthy() {
  for container in $(containers "$1"); do
    for _ in $(seq 60); do
      podman healthcheck run "$container" >/dev/null 2>&1 && continue 2
      sleep 1
    done
    echo "$1 did not become healthy"
    return 1
  done
}

step "token of the workers"
compose up --detach --no-build --no-deps tokens >/dev/null
tokens=$(podman ps --all --quiet --filter "label=com.docker.compose.service=tokens")
[ "$(podman wait "$tokens")" = 0 ] || { echo "no token was made"; exit 1; }

step "coordinator"
compose up --detach --no-build --no-deps coordinator >/dev/null
healthy coordinator

step "two workers"
compose up --detach --no-build --no-deps --scale worker=2 worker >/dev/null
healthy worker
[ "$(containers worker | wc -l)" = 2 ] || { echo "there are not two workers"; exit 1; }

step "study"
coordinator=$(containers coordinator)
podman exec "$coordinator" manduca study submit quick --wait
podman exec "$coordinator" manduca workers list
podman exec "$coordinator" manduca optimum latest --json >"$work/optimum.json"
python3 - "$work/optimum.json" <<'PYTHON'
import json, sys

optima = json.load(open(sys.argv[1]))["optimisations"]
assert optima and all(optimum["status"] == "refined" for optimum in optima), optima
PYTHON

step "end"
podman stop --time 60 $(containers worker) "$coordinator" >/dev/null
for container in $(podman ps --all --quiet); do
  code=$(podman inspect --format '{{.State.ExitCode}}' "$container")
  [ "$code" = 0 ] || { echo "$(podman inspect --format '{{.Name}}' "$container") ended with $code when told to stop"; exit 1; }
done
echo "image and compose file: all well"
