"""The control interface of a hub: JSON-RPC 2.0."""
