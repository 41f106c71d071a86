"""Operate a rig from a browser: device process, shared session, web page and HTTP API."""
