//! The representation of a sample in shared memory.

use std::fmt;

use iceoryx2::prelude::ZeroCopySend;
use messages::ros::Payload;

/// A message with the type name that iceoryx2 compares between peers.
#[repr(transparent)]
#[derive(Clone, Copy)]
pub(crate) struct ShmSample<T: Payload>(pub(crate) T);

impl<T: Payload> fmt::Debug for ShmSample<T> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(T::NAME)
    }
}

// SAFETY: a `Payload` is `Pod`: no pointers, no padding, and every bit pattern is valid at any address. The name ends
// in a hash of the layout, so two definitions with the same name have the same memory layout.
#[allow(unsafe_code)]
unsafe impl<T: Payload> ZeroCopySend for ShmSample<T> {
    unsafe fn type_name() -> &'static str {
        T::type_name()
    }
}
