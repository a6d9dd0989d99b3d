"""What a QoS profile of the middleware is worth: messages in, loop times and QoC out."""
