"""Results and state to an MQTT broker: a thread that empties the outbox of the store.

Knows nothing of grasps: it takes documents. The topics are ``TOPIC/result`` (each result, in order,
at least once), ``TOPIC/state`` (the newest, retained) and ``TOPIC/online`` (retained; the broker
itself publishes it as false when the connection dies).
"""
