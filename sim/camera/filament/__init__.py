"""The physically based renderer: MuJoCo's Filament, over Vulkan."""
