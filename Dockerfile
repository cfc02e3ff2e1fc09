# docker build -t shellbench .
# docker run --rm -v "$PWD:/work" shellbench quick
FROM python:3.12-slim
ENV PIP_NO_CACHE_DIR=1 PYTHONDONTWRITEBYTECODE=1
WORKDIR /source
COPY . .
# PyTorch without CUDA: nothing here needs a GPU, and it takes a fifth of the room.
RUN python -m pip install -q -c constraints.txt --extra-index-url https://download.pytorch.org/whl/cpu ".[compiled]" \
 && rm -rf /source
RUN useradd --create-home shell
USER shell
WORKDIR /work
ENTRYPOINT ["shellbench"]
CMD ["--help"]
