"""What happens in the world: rover, cameras, rendering, recording."""
