"""Results and state to an MQTT broker, by a thread that empties the store's outbox.

It sends any documents. The topics are ``TOPIC/result`` (each result, in order,
at least once), ``TOPIC/state`` (the newest, retained) and ``TOPIC/online`` (retained; the broker
itself publishes it as false when the connection dies).
"""
