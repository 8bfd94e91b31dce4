"""Motions of hands: reads pose and landmark files of many formats, and reads and writes LiveHand's own."""
