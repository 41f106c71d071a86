"""Publish results and state to an MQTT broker from a background thread.

Topics: ``TOPIC/result`` carries each result in order, at least once. ``TOPIC/state`` carries the
newest state, retained. ``TOPIC/online`` is retained; the broker sets it to false (last will) when
the connection is lost.
"""
