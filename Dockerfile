# jaxsim in a container.
#   CPU:   docker build -t jaxsim .
#   CUDA:  docker build -t jaxsim-cuda --build-arg EXTRA=cuda .      (the wheels bring CUDA; the host needs a driver)
#   run:   docker run --rm -v "$PWD:/data" jaxsim simulate embedded --out simulated      (add --gpus all for CUDA)
FROM python:3.12-slim AS build
ARG EXTRA=
WORKDIR /src
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY jaxsim jaxsim
COPY configs configs
RUN python -m venv /opt/jaxsim && \
    /opt/jaxsim/bin/pip install --no-cache-dir --constraint constraints.txt ".${EXTRA:+[$EXTRA]}"

FROM python:3.12-slim
COPY --from=build /opt/jaxsim /opt/jaxsim
# Compiled programs and results belong to whoever runs it, not to root; by number, which hosts know without its name.
RUN useradd --create-home --uid 1000 jaxsim
USER 1000
WORKDIR /data
ENTRYPOINT ["/opt/jaxsim/bin/jaxsim"]
CMD ["--help"]
