"""Scenes that come with the package, as TOML files: `Scene.shipped("idealised")`."""

__all__: list[str] = []
