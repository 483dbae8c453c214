"""Files of a dataset: sensor descriptions, tables, manifest and image codecs."""
