"""Streams and links: a camera and a flight controller in, depth and obstacle distances out."""
