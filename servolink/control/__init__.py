"""The contract between a hub and its programs: greeting, roles, messages, notifications, faults, and JSON-RPC 2.0."""
