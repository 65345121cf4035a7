# One image for every role: `manduca serve`, `manduca worker`, `manduca study ...`.
FROM rust:1.95-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends build-essential pkg-config && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY . .
RUN cargo build --release --locked -p manduca-cli

FROM debian:bookworm-slim
# Certificates that clients and workers check an https:// coordinator against.
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates && rm -rf /var/lib/apt/lists/*
# The second folder is for tokens, which are not kept beside the database.
RUN useradd --system --create-home --home-dir /var/lib/manduca manduca \
    && install --directory --owner=manduca --group=manduca --mode=0700 /var/lib/manduca-tokens
COPY --from=build /src/target/release/manduca /usr/local/bin/manduca
USER manduca
VOLUME /var/lib/manduca
EXPOSE 8080
ENV MANDUCA_DATA=/var/lib/manduca
# SIGTERM drains: a worker finishes and delivers its jobs, the coordinator its requests.
STOPSIGNAL SIGTERM
ENTRYPOINT ["manduca"]
CMD ["--help"]
