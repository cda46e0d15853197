"""One thin command per file: read artefacts, one library call, write one artefact."""
