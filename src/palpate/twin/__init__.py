"""The physical twin: object, fingers, sheet, divider and converter. All it gives is simulated."""
