"""What several test files share: hand-made meshes, solved meshes, and checks of whole runs. It tests nothing by itself."""
