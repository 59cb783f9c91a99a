//! Typed ports, untyped tap, waking and requests over shared memory.
