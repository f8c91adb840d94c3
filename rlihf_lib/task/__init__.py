"""The robot's world: scene, control, ideal path, Gymnasium interface."""
