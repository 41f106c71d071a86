# palpate with everything optional, and the firmware for `palpate flash`:
#   docker build -t palpate . && docker run --rm palpate grasp --seed 1
# A board needs its port handed in: docker run --device /dev/ttyACM0 ...
# The page and the API, from outside of the container, with the data kept in a volume:
#   docker run -p 8080:8080 -v palpate:/work -e PALPATE_TOKEN=... palpate serve --rig sim-rigid
FROM python:3.12-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends make gcc-avr avr-libc binutils-avr
COPY . /src
WORKDIR /src
RUN make -C firmware image && pip wheel --no-deps --wheel-dir /dist . \
  ./packages/pattern ./packages/station ./packages/foxglove ./packages/studies ./packages/archive \
  ./packages/lerobot-dataset

FROM python:3.12-slim
RUN apt-get update && apt-get install -y --no-install-recommends avrdude && rm -rf /var/lib/apt/lists/*
COPY --from=build /dist /dist
RUN pip install --no-cache-dir "$(ls /dist/palpate-*.whl)[all]" "$(ls /dist/palpate_pattern-*.whl)[dxf]" \
  "$(ls /dist/palpate_station-*.whl)[all]" /dist/palpate_[aflm]*.whl /dist/palpate_studies-*.whl \
  && rm -r /dist
WORKDIR /work
# Inside of the container, the loopback can't be reached from outside; serve then requires a token.
ENV PALPATE_HOST=0.0.0.0
# The outbox of a shared store belongs to the data of the volume too.
ENV XDG_STATE_HOME=/work
EXPOSE 8080
ENTRYPOINT ["palpate"]
