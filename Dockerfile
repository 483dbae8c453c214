# driftyard with a software OpenGL driver, in a folder that is mounted:
#   docker build --tag driftyard .
#   docker run --rm --volume "$PWD:/data" driftyard generate office --out office
FROM python:3.12-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
    && rm -rf /var/lib/apt/lists/*
COPY . /driftyard
RUN pip install --no-cache-dir /driftyard \
    && python -c "from vo.precompile import compile_ahead; compile_ahead()" \
    && driftyard doctor
WORKDIR /data
ENTRYPOINT ["driftyard"]
CMD ["--help"]
