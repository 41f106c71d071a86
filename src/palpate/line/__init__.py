"""OPC UA and Modbus TCP: the commands and results of `palpate serve` for a line's controllers."""
