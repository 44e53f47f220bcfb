#!/usr/bin/env bash
# Peers of the benchmarks in an environment of their own, .venv-peers: their licences and their OpenCV stay out of the
# project's. Needs the project's environment (make), whose packages it sees behind its own.
# Usage: bash benchmarks/peers.sh [PYTHON of the project's environment]; then run benchmarks with .venv-peers/bin/python.
set -euo pipefail
cd "$(dirname "$0")/.."
python=${1:-.venv/bin/python}
"$python" -m venv --without-pip .venv-peers
own=$(.venv-peers/bin/python -c 'import site; print(site.getsitepackages()[0])')
installer=$(command -v pip || command -v pip3)
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
# Without dependencies: numpy, scipy, numba, OpenCV and scikit-image are the project's.
"$installer" install --quiet --target "$own" --upgrade --no-deps --only-binary=:all: --python-version "$version" \
  kamui==0.3.0 pylmcf nanobind-backend fringes==2.1.0 sympy mpmath pyyaml
"$python" -c 'import site; print("import sys; sys.path.append(%r)" % site.getsitepackages()[0])' > "$own/project.pth"
echo "$PWD/src" > "$own/fringecal.pth"
.venv-peers/bin/python -c 'import kamui, fringes; print("kamui", "fringes", fringes.__version__, "ready")'
