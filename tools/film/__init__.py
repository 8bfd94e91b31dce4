"""The film: two minutes of what LiveHand does, made of the examples by one command."""
