"""The sections of a scenario file: fields with units, defaults and bounds."""
