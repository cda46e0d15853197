#!/usr/bin/env bash
# Bundles src/ into bundles/, which is committed and shipped: only who changes src/ runs it. Needs node and npm, and a
# network for the first `npm install`. The first line of a bundle names the sources that it is made of; a test compares.
set -euo pipefail
cd "$(dirname "$0")"
[ -d node_modules ] || npm install --no-save --no-package-lock --no-audit --no-fund
sources=$(find src -type f | LC_ALL=C sort | xargs cat | sha256sum | cut -d' ' -f1)
node_modules/.bin/esbuild src/report.js src/playground.js --bundle --minify --format=iife --target=es2022 --loader:.glsl=text \
    --banner:js="// made by ldsim/web/build.sh, sources $sources" --outdir=bundles
