"""OPC UA and Modbus TCP interfaces of `palpate serve` for line controllers."""
