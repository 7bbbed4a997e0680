# The README's first command, and the page that it writes:
#   docker build -t lis_grasp .
#   docker run --rm -p 127.0.0.1:7000:7000 lis_grasp                # then open http://localhost:7000
#   docker run --rm -v "$PWD/results:/srv/lis_grasp/results" lis_grasp run mallet --seed 3
FROM python:3.11-slim-bookworm

# Drake's wheel needs this system library.
RUN apt-get update -qq \
    && apt-get install -y -qq --no-install-recommends libglib2.0-0 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/lis_grasp
COPY pyproject.toml README.md LICENSE ./
COPY lis_grasp lis_grasp
COPY lis_grasp_studies lis_grasp_studies
COPY models models
RUN python -m pip install --no-cache-dir .

# Not root: files in a mounted folder belong to the user who mounts it.
RUN useradd --create-home --uid 1000 robot && install -d -o robot /srv/lis_grasp
USER robot
WORKDIR /srv/lis_grasp
RUN lis-grasp run box --output results/demo

EXPOSE 7000
ENTRYPOINT ["lis-grasp"]
CMD ["view", "results/demo", "--host", "0.0.0.0"]
