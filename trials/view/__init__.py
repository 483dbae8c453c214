"""Views of datasets and runs in Rerun's viewer."""
