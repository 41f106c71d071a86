"""The physical twin: object, fingers, sheet, divider and converter. All output is simulated."""
