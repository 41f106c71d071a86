"""OPC UA and Modbus TCP: commands and results of `palpate serve` for a line's controllers."""
