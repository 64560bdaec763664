//! Bounded random access to accessors: every component type, strides, normalised integers,
//! sparse values.

use super::REEXPORT;
use super::buffers::Buffers;
use super::extensions;
use super::schema;
use crate::MeshError;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn from_code(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// The value at the start of `bytes`, which the caller has checked to be long enough.
    fn read(self, bytes: &[u8]) -> f64 {
        let pair = || [bytes[0], bytes[1]];
        let quad = || [bytes[0], bytes[1], bytes[2], bytes[3]];
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(pair())),
            Self::U16 => f64::from(u16::from_le_bytes(pair())),
            Self::U32 => f64::from(u32::from_le_bytes(quad())),
            Self::F32 => f64::from(f32::from_le_bytes(quad())),
        }
    }

    /// What a normalised integer is divided by.
    fn scale(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::U32 => 4_294_967_295.0,
            Self::F32 => 1.0,
        }
    }
}

/// Elements at a fixed distance from each other; the range has been checked.
struct Elements<'b> {
    bytes: &'b [u8],
    stride: usize,
}

struct Sparse<'b> {
    /// Strictly ascending.
    indices: Elements<'b>,
    index_type: Component,
    count: usize,
    values: Elements<'b>,
}

impl Sparse<'_> {
    fn index(&self, k: usize) -> usize {
        self.index_type.read(&self.indices.bytes[k * self.indices.stride..]) as usize
    }

    /// Position of element `i` among the sparse values.
    fn find(&self, i: usize) -> Option<usize> {
        let (mut low, mut high) = (0, self.count);
        while low < high {
            let middle = low.midpoint(high);
            if self.index(middle) < i { low = middle + 1 } else { high = middle }
        }
        (low < self.count && self.index(low) == i).then_some(low)
    }
}

/// What an accessor must look like for its use.
pub(super) struct Shape {
    /// Accepted values of `type`.
    pub kinds: &'static [&'static str],
    /// Accepted component types.
    pub components: &'static [Component],
    /// Whether an accessor without data stands for zeros.
    pub zeros: bool,
}

/// An accessor whose every element is known to be readable.
pub(super) struct Accessor<'b> {
    elements: Option<Elements<'b>>,
    sparse: Option<Sparse<'b>>,
    component: Component,
    width: usize,
    count: usize,
    normalized: bool,
}

impl<'b> Accessor<'b> {
    /// Checks accessor `index` against `shape` and the bytes it refers to; `object` names its use.
    pub fn open(buffers: &'b Buffers, object: &str, index: usize, shape: &Shape) -> Result<Self, MeshError> {
        let (source, root) = (buffers.source(), buffers.root());
        let object = format!("{object} (accessor {index})");
        let Some(accessor) = root.accessors.get(index) else {
            return Err(source.invalid(
                object,
                format!("the accessor does not exist, there are {}", root.accessors.len()),
                REEXPORT,
            ));
        };
        let component =
            Component::from_code(accessor.component_type).filter(|c| shape.components.contains(c));
        let Some(component) = component else {
            return Err(source.invalid(
                object,
                format!("component type {} is not allowed here", accessor.component_type),
                REEXPORT,
            ));
        };
        let width = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            _ => 0,
        };
        if !shape.kinds.contains(&accessor.kind.as_str()) {
            return Err(source.invalid(
                object,
                format!("its type is not {}", shape.kinds.join(" or ")),
                REEXPORT,
            ));
        }
        let size = width * component.size();
        let count = accessor.count;
        let elements = match accessor.buffer_view {
            Some(view) => Some(elements(buffers, &object, view, accessor.byte_offset, count, size, true)?),
            None => None,
        };
        let sparse = match &accessor.sparse {
            Some(sparse) => Some(open_sparse(buffers, &object, sparse, count, size)?),
            None => None,
        };
        if elements.is_none() && sparse.is_none() && !shape.zeros {
            return Err(extensions::no_data(source, root, &object));
        }
        let normalized = accessor.normalized && component != Component::F32;
        Ok(Self { elements, sparse, component, width, count, normalized })
    }

    /// The same accessor with integers read as fractions, whether or not the file says so: for
    /// attributes that nothing else fits.
    pub fn normalized(self) -> Self {
        Self { normalized: self.component != Component::F32, ..self }
    }

    /// Number of elements.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Element `i` (below [`Accessor::count`]), its missing components `fill`.
    pub fn get<const N: usize>(&self, i: usize, fill: f64) -> [f64; N] {
        let found = match self.sparse.as_ref().and_then(|s| Some((s, s.find(i)?))) {
            Some((sparse, k)) => Some(&sparse.values.bytes[k * sparse.values.stride..]),
            None => self.elements.as_ref().map(|e| &e.bytes[i * e.stride..]),
        };
        std::array::from_fn(|c| match found {
            _ if c >= self.width => fill,
            None => 0.0,
            Some(bytes) => {
                let value = self.component.read(&bytes[c * self.component.size()..]);
                // The most negative integer normalises to -1, as its neighbour does.
                if self.normalized { (value / self.component.scale()).max(-1.0) } else { value }
            }
        })
    }
}

/// `count` elements of `size` bytes in a buffer view, the whole range checked.
fn elements<'b>(
    buffers: &'b Buffers,
    object: &str,
    view: usize,
    offset: usize,
    count: usize,
    size: usize,
    may_stride: bool,
) -> Result<Elements<'b>, MeshError> {
    let (description, bytes) = buffers.view(object, view)?;
    let stride = description.byte_stride.filter(|_| may_stride).unwrap_or(size);
    if stride < size {
        return Err(buffers.source().invalid(
            object,
            format!("its elements of {size} bytes overlap at a stride of {stride}"),
            REEXPORT,
        ));
    }
    let span = match count {
        0 => Some(0),
        _ => (count - 1).checked_mul(stride).and_then(|s| s.checked_add(size)),
    };
    let bytes = span.and_then(|s| s.checked_add(offset)).and_then(|end| bytes.get(offset..end));
    match bytes {
        Some(bytes) => Ok(Elements { bytes, stride }),
        None => Err(buffers.source().invalid(
            object,
            format!("{count} elements do not fit into buffer view {view}"),
            REEXPORT,
        )),
    }
}

fn open_sparse<'b>(
    buffers: &'b Buffers,
    object: &str,
    sparse: &schema::Sparse,
    count: usize,
    size: usize,
) -> Result<Sparse<'b>, MeshError> {
    let invalid = |reason: String| buffers.source().invalid(format!("{object}, sparse"), reason, REEXPORT);
    let index_type = sparse.indices.component_type.and_then(Component::from_code);
    let unsigned = [Component::U8, Component::U16, Component::U32];
    let Some(index_type) = index_type.filter(|t| unsigned.contains(t)) else {
        return Err(invalid("its index type is not an unsigned integer".into()));
    };
    if sparse.count > count {
        return Err(invalid(format!("it replaces {} of {count} elements", sparse.count)));
    }
    let part = |p: &schema::SparsePart, what: &str, size| {
        let object = format!("{object}, sparse {what}");
        elements(buffers, &object, p.buffer_view, p.byte_offset, sparse.count, size, false)
    };
    let indices = part(&sparse.indices, "indices", index_type.size())?;
    let values = part(&sparse.values, "values", size)?;
    let sparse = Sparse { indices, index_type, count: sparse.count, values };
    let mut next = 0;
    for k in 0..sparse.count {
        let index = sparse.index(k);
        if index < next || index >= count {
            return Err(invalid(format!("index {index} is not ascending and below {count}")));
        }
        next = index + 1;
    }
    Ok(sparse)
}
