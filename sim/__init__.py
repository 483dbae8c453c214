"""The simulator: rover, cameras, rendering, recording."""
