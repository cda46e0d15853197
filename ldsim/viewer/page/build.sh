#!/usr/bin/env bash
# Bundles src/ and three.js into ../web/app.js; needs node and npm, and a network for the first `npm install`. Only who
# changes the page runs it: the bundle is committed and shipped.
set -euo pipefail
cd "$(dirname "$0")"
[ -d node_modules ] || npm install --no-save --no-package-lock --no-audit --no-fund
node_modules/.bin/esbuild src/main.js --bundle --minify --format=iife --target=es2022 --legal-comments=none --outfile=../web/app.js
{
    echo "app.js is made of the sources of ldsim (MIT licence) and of three.js, whose licence follows."
    echo
    cat node_modules/three/LICENSE
} >../web/licences.txt
