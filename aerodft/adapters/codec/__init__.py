"""Model values to JSON payloads and back, one module a payload, with the JSON Schemas that are published."""
