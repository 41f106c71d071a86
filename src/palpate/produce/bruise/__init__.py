"""Is an item bruised, and where: against its own record, its other sides, sound items."""
