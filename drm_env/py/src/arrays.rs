//! NumPy arrays at the edge: dtype and rank are checked on the way in, and each has a type hint for the
//! stub. What is read is copied while the interpreter is held: another thread may write to an array as
//! soon as it is not.

use std::convert::Infallible;

use numpy::ndarray::{Dimension, IntoDimension, Ix1, Ix2, Ix3};
use numpy::{
    Element, PyArray, PyArrayMethods, PyReadwriteArray, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{
    PyKeyboardInterrupt, PyMemoryError, PyOverflowError, PyTypeError, PyValueError,
};
use pyo3::inspect::PyStaticExpr;
use pyo3::prelude::*;
use pyo3::{type_hint_identifier, type_hint_subscript};

use crate::error::guarded;

/// Element types that cross the boundary, with their name in the stub.
pub(crate) trait Scalar: Element + Copy {
    /// NumPy's name of the type.
    const NAME: &'static str;
    /// `numpy.typing.NDArray[...]` of it.
    const HINT: PyStaticExpr;

    /// Reads one from wherever NumPy keeps it.
    ///
    /// # Safety
    /// There must be `size_of::<Self>()` bytes, and any bytes must be a value.
    #[inline(always)]
    unsafe fn read(from: *const u8) -> Self {
        // SAFETY: the caller's, and it need not be aligned
        unsafe { from.cast::<Self>().read_unaligned() }
    }
}

macro_rules! scalar {
    ($($t:ty => $name:literal $({ $($more:tt)* })?),+ $(,)?) => {$(
        impl Scalar for $t {
            $($($more)*)?
            const NAME: &'static str = $name;
            const HINT: PyStaticExpr = type_hint_subscript!(
                type_hint_identifier!("numpy.typing", "NDArray"),
                type_hint_identifier!("numpy", $name)
            );
        }
    )+};
}
scalar!(
    f32 => "float32",
    f64 => "float64",
    u8 => "uint8",
    bool => "bool_" {
        /// NumPy takes every byte but 0 for true.
        #[inline(always)]
        unsafe fn read(from: *const u8) -> Self {
            // SAFETY: the caller's
            unsafe { *from != 0 }
        }
    },
);

fn describe(object: Borrowed<'_, '_, PyAny>) -> String {
    match object.cast::<PyUntypedArray>() {
        Ok(array) => format!("a {} array of shape {:?}", array.dtype(), array.shape()),
        Err(_) => object
            .get_type()
            .name()
            .map_or_else(|_| "an unnamed type".into(), |name| name.to_string()),
    }
}

fn checked<'a, 'py, T: Scalar, D: Dimension>(
    object: Borrowed<'a, 'py, PyAny>,
) -> PyResult<Borrowed<'a, 'py, PyArray<T, D>>> {
    object.cast::<PyArray<T, D>>().map_err(|_| {
        let rank = D::NDIM.map_or_else(String::new, |n| format!("{n}-D "));
        PyTypeError::new_err(format!(
            "expected a {rank}{} array, got {}",
            T::NAME,
            describe(object)
        ))
    })
}

/// Appends the entries of an array, row by row.
///
/// # Safety
/// Shape, strides (bytes) and `data` must be those of an array that nobody writes to meanwhile.
unsafe fn gather<T: Scalar>(
    data: *const u8,
    shape: &[usize],
    strides: &[isize],
    into: &mut Vec<T>,
) {
    // SAFETY: the caller's; offsets stay within the array
    unsafe {
        match (shape, strides) {
            ([count], [stride]) if *stride == size_of::<T>() as isize => {
                into.extend((0..*count).map(|i| T::read(data.add(i * size_of::<T>()))));
            }
            ([count, shape @ ..], [stride, strides @ ..]) => {
                for i in 0..*count {
                    gather(data.offset(i as isize * stride), shape, strides, into);
                }
            }
            _ => into.push(T::read(data)),
        }
    }
}

/// What an array held when it came in: whatever its strides, alignment and flags.
pub(crate) struct In<T, D> {
    values: Vec<T>,
    shape: D,
}
pub(crate) type In1<T> = In<T, Ix1>;
pub(crate) type In2<T> = In<T, Ix2>;
pub(crate) type In3<T> = In<T, Ix3>;

impl<T: Scalar, D: Dimension> In<T, D> {
    pub(crate) fn slice(&self) -> &[T] {
        &self.values
    }

    pub(crate) fn shape(&self) -> &[usize] {
        self.shape.slice()
    }
}

impl<'a, 'py, T: Scalar + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for In<T, D> {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = T::HINT;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = checked::<T, D>(object)?;
        // nobody of ours writes to it in another thread
        let _borrow = array.try_readonly()?;
        let (shape, count) = (array.dims(), array.len());
        let mut values = Vec::new();
        if values.try_reserve_exact(count).is_err() {
            let text = format!("no memory for a copy of {}", describe(object));
            return Err(PyMemoryError::new_err(text));
        }
        let data = array.data().cast::<u8>();
        // SAFETY: the array is borrowed and the interpreter held; every value of a `Scalar` can be read
        unsafe {
            if array.is_c_contiguous() {
                let stride = size_of::<T>() as isize;
                gather(data, &[count], &[stride], &mut values);
            } else if count > 0 {
                gather(data, shape.slice(), array.strides(), &mut values);
            }
        }
        Ok(Self { values, shape })
    }
}

/// A C-contiguous, aligned and writeable array that is filled in place.
pub(crate) struct InOut<'py, T: Scalar, D: Dimension>(PyReadwriteArray<'py, T, D>);
pub(crate) type InOut1<'py, T> = InOut<'py, T, Ix1>;
pub(crate) type InOut2<'py, T> = InOut<'py, T, Ix2>;

impl<T: Scalar, D: Dimension> InOut<'_, T, D> {
    pub(crate) fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    /// Overwrites it; both have the same length.
    pub(crate) fn fill(&mut self, values: &[T]) {
        assert_eq!(self.0.len(), values.len(), "lengths were compared before");
        // SAFETY: as many entries follow each other there, aligned, and nobody else has them borrowed
        unsafe { std::ptr::copy_nonoverlapping(values.as_ptr(), self.0.data(), values.len()) }
    }
}

/// Numbers, that is: bytes of NumPy's need not be `bool`s.
macro_rules! in_place {
    ($($t:ty),+) => {$(
        impl<D: Dimension> InOut<'_, $t, D> {
            pub(crate) fn slice_mut(&mut self) -> &mut [$t] {
                self.0
                    .as_slice_mut()
                    .expect("contiguity and alignment were checked on extraction")
            }
        }
    )+};
}
in_place!(f32, f64);

impl<'a, 'py, T: Scalar + 'a, D: Dimension + 'a> FromPyObject<'a, 'py> for InOut<'py, T, D> {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = T::HINT;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let array = checked::<T, D>(object)?;
        if !array.is_c_contiguous() || !array.data().is_aligned() {
            return Err(PyValueError::new_err(format!(
                "expected a C-contiguous, aligned array to write to, got strides {:?}",
                array.strides()
            )));
        }
        Ok(Self(array.try_readwrite()?))
    }
}

/// Loads NumPy and what this module needs of it.
///
/// # Errors
/// What the import raises, or a handler of a signal meanwhile.
pub(crate) fn load(py: Python<'_>) -> PyResult<()> {
    py.import("numpy")?;
    let first = || {
        let array = PyArray::from_vec(py, vec![0.0_f64; SMALL]);
        let _borrow = array.readonly();
        Ok::<_, PyErr>(())
    };
    match guarded(first) {
        Ok(()) => Ok(()),
        // NumPy is there: what comes between is a signal
        Err(_) => Err(PyKeyboardInterrupt::new_err("while numpy was being loaded")),
    }
}

/// A number of things; what is too large for the machine is its largest number, which is more than there
/// ever is.
#[derive(Clone, Copy)]
pub(crate) struct Count(pub(crate) usize);

impl<'a, 'py> FromPyObject<'a, 'py> for Count {
    type Error = PyErr;
    const INPUT_TYPE: PyStaticExpr = <usize as FromPyObject<'a, 'py>>::INPUT_TYPE;

    fn extract(object: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        match object.extract::<usize>() {
            Ok(count) => Ok(Self(count)),
            Err(error)
                if error.is_instance_of::<PyOverflowError>(object.py()) && object.gt(0)? =>
            {
                Ok(Self(usize::MAX))
            }
            Err(error) => Err(error),
        }
    }
}

/// A fresh array, handed to Python.
pub(crate) struct Out<'py, T: Scalar, D: Dimension>(Bound<'py, PyArray<T, D>>);
pub(crate) type Out1<'py, T> = Out<'py, T, Ix1>;
pub(crate) type Out2<'py, T> = Out<'py, T, Ix2>;
pub(crate) type Out3<'py, T> = Out<'py, T, Ix3>;

/// Bytes up to which copying is faster than handing memory over.
const SMALL: usize = 4096;

impl<'py, T: Scalar, D: Dimension> Out<'py, T, D> {
    /// An array of `shape` that holds `values`, row by row.
    ///
    /// # Panics
    /// If these are not as many as the shape says.
    pub(crate) fn new<S: IntoDimension<Dim = D>>(
        py: Python<'py>,
        shape: S,
        values: Vec<T>,
    ) -> Self {
        if size_of_val(values.as_slice()) > SMALL {
            // takes their memory: NumPy would have none to spare for a copy without a word
            let array = PyArray::from_vec(py, values).reshape(shape.into_dimension());
            return Self(array.expect("there are as many values as the shape says"));
        }
        let array = PyArray::<T, D>::zeros(py, shape, false);
        array
            .readwrite()
            .as_slice_mut()
            .expect("a fresh array is contiguous")
            .copy_from_slice(&values);
        Self(array)
    }
}

impl<'py, T: Scalar> Out1<'py, T> {
    /// A vector that holds `values`.
    pub(crate) fn vector(py: Python<'py>, values: Vec<T>) -> Self {
        Self::new(py, values.len(), values)
    }
}

impl<'py> Out2<'py, f64> {
    /// A matrix of the given rows.
    pub(crate) fn matrix<const N: usize>(py: Python<'py>, rows: Vec<[f64; N]>) -> Self {
        Self::new(py, (rows.len(), N), rows.into_flattened())
    }
}

impl<'py, T: Scalar, D: Dimension> IntoPyObject<'py> for Out<'py, T, D> {
    type Target = PyArray<T, D>;
    type Output = Bound<'py, Self::Target>;
    type Error = Infallible;
    const OUTPUT_TYPE: PyStaticExpr = T::HINT;

    fn into_pyobject(self, _py: Python<'py>) -> Result<Self::Output, Infallible> {
        Ok(self.0)
    }
}
