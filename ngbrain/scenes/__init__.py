"""Scenes that come with the package, as TOML: `Scene.shipped("idealised")`."""
