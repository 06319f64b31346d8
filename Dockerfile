# Image for Prefect's docker and kubernetes work pools and for Dask workers (docs/prefect.md).
# Linted by the tests; not built here, as these machines have no container engine.
#
#   docker build --tag mattgs-bench:0.1.0 .

FROM python:3.11.13-slim-bookworm AS build
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
# compiles the C++ kernels; stays out of the final image
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends g++ make \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY . .
# the CPU build of torch: the one on PyPI brings gigabytes of CUDA
RUN python -m venv /opt/venv \
    && /opt/venv/bin/pip install --no-cache-dir torch==2.13.0 \
        --index-url https://download.pytorch.org/whl/cpu \
    && /opt/venv/bin/pip install --no-cache-dir '.[s3]'

FROM python:3.11.13-slim-bookworm
COPY --from=build /opt/venv /opt/venv
ENV PATH=/opt/venv/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    MATTGS_WORK=/data
# stages write here: mount a volume, or share results by --store
RUN useradd --create-home --uid 1000 mattgs && install --directory --owner mattgs /data
USER 1000
WORKDIR /data
CMD ["mattgs", "--help"]
