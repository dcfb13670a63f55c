"""A cell over a sequence: layers, streams, telemetry."""
