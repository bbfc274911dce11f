"""Ready scenes as TOML files."""
