"""OPC UA and Modbus TCP interfaces of `palpate serve` for the controllers of a packing line."""
