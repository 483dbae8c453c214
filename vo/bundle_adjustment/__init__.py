"""Bundle adjustment of keyframes and landmarks."""
