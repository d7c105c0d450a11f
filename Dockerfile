# An image with the program, built from the wheel: docker build -t sumo-eval . && docker run --rm -v "$PWD:/work" sumo-eval run --out first
FROM python:3.12-slim AS build
WORKDIR /source
RUN pip install --no-cache-dir build
COPY . .
RUN python -m build --wheel --outdir /wheels

FROM python:3.12-slim
# What SUMO's library links beside what the image has: a test holds it against SYSTEM_LIBRARIES of cosim/sumo/session.py.
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libatomic1 libexpat1 libgl1 libx11-6 libxext6 libxrender1 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheels/*.whl /tmp/
RUN pip install --no-cache-dir /tmp/*.whl && rm /tmp/*.whl
RUN useradd --create-home evaluator
USER evaluator
WORKDIR /work
ENTRYPOINT ["sumo-eval"]
CMD ["--help"]
