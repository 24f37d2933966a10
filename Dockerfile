# ngbrain with all that its commands need. Not tested: no Docker daemon was at hand where it was written; its commands were, one by
# one, in an environment of the same Python.
#   docker build -t ngbrain .
#   docker run --rm -v "$PWD":/data ngbrain mesh T1.nii.gz -o head
#   docker run --rm ngbrain doctor
FROM python:3.13-slim

RUN apt-get update \
    && apt-get install --no-install-recommends --yes libquadmath0 \
    && rm -rf /var/lib/apt/lists/*

COPY . /source
RUN pip install --no-cache-dir "/source[demo]" && rm -rf /source

# Meshes and labels are cached here: give it a volume to keep them.
ENV OPENBLAS_NUM_THREADS=1 NGBRAIN_CACHE=/cache
RUN mkdir -m 777 /cache /data
WORKDIR /data
ENTRYPOINT ["ngbrain"]
