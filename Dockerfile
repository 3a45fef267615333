# The project with Debian's YADE, for systems without it:
#
#     docker build -t grain-scatter .
#     docker run --rm -v "$PWD:/work" grain-scatter all mine.toml
#
# Campaigns are in the folder runs/ of the present folder.
FROM debian:12
RUN apt-get update && apt-get install -y --no-install-recommends \
    yade python3-h5py python3-pandas python3-scipy python3-matplotlib python3-openpyxl python3-plotly python3-pip \
    && rm -rf /var/lib/apt/lists/*
COPY . /opt/grain-scatter
RUN pip install --break-system-packages --no-deps --no-build-isolation /opt/grain-scatter
WORKDIR /work
ENTRYPOINT ["grain-scatter"]
