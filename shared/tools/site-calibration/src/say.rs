//! The words of the guide.

/// A sentence of the guide, as `format!`. The page translates what stands in this macro; a test of the page collects it
/// from the source, so that the English words stand in one place.
#[macro_export]
macro_rules! say {
    ($($sentence:tt)*) => {
        ::std::fmt::format(::std::format_args!($($sentence)*))
    };
}
