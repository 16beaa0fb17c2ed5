"""The command and telemetry link: space packets, frames with a check sum, signed commands. Used by both ends."""
