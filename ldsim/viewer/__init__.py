"""The playground in the browser: a server that steps, a page that draws and pulls."""
