# The workflow with the versions of requirements.lock:
#   docker build -t evopem . && docker run --rm --user $(id -u):$(id -g) -v "$PWD:/data" evopem
# runs the config.yaml of this folder. Apptainer: apptainer build evopem.sif docker-daemon://evopem:latest
FROM python:3.12-slim
COPY requirements.lock /opt/evopem/
RUN python -m pip install --no-cache-dir --require-hashes -r /opt/evopem/requirements.lock
COPY . /opt/evopem/
RUN python -m pip install --no-cache-dir --no-deps /opt/evopem
WORKDIR /data
CMD ["snakemake", "--snakefile", "/opt/evopem/Snakefile", "--directory", "."]
