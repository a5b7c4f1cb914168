"""JSON payloads with their schemas, one module a payload."""
