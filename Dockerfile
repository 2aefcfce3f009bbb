# The environment of `make env` in an image, and the commands of README.md in it:
#
#   docker build --tag aircraft-sysid .
#   docker run --rm aircraft-sysid make demo
#   docker run --rm aircraft-sysid make test
#   docker run --rm --network host --user "$(id -u)" --env HOME=/tmp --volume "$PWD:/flights" --workdir /flights \
#       aircraft-sysid aircraft-sysid live --aircraft my.yaml --out today
#
# Debian and Ubuntu alike: --build-arg BASE=ubuntu:24.04
ARG BASE=debian:bookworm-slim
FROM ${BASE}

# Versions are those of the release that BASE names. The tests of the page are skipped: they want Chromium.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates g++ python3-dev python3-venv make \
    && rm -rf /var/lib/apt/lists/*

RUN useradd --uid 10001 --create-home sysid && install --directory --owner sysid /opt/aircraft_sysid_ros
USER 10001
WORKDIR /opt/aircraft_sysid_ros
COPY --chown=10001 . .
RUN make env
ENV PATH=/opt/aircraft_sysid_ros/.venv/bin:$PATH
CMD ["aircraft-sysid", "--help"]
