"""How far simulated recordings are from real ones: statistics, distances, and matched cameras."""
