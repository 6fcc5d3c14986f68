//! The bytes behind a glTF document, and the numbers in them. Every offset and count is checked against
//! what is there before anything of its size is made.

use super::super::source::MAX_OBJ_BYTES;
use super::{beside, read_bytes};
use base64::Engine;
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::{Index, Root, buffer};
use std::collections::HashMap;
use std::path::Path;

/// More values than this no accessor has.
const MOST_VALUES: usize = 1 << 28;

/// The buffers of a document.
pub struct Buffers<'a> {
    root: &'a Root,
    bytes: Vec<Vec<u8>>,
}

type Read<T> = std::result::Result<T, String>;

impl<'a> Buffers<'a> {
    /// Reads the buffers that `root` names beside `path`; `binary` is the binary part of a .glb file.
    pub fn read(root: &'a Root, path: &Path, mut binary: Option<Vec<u8>>) -> Read<Buffers<'a>> {
        let mut bytes = Vec::with_capacity(root.buffers.len());
        let mut total: u64 = 0;
        for (i, buffer) in root.buffers.iter().enumerate() {
            let found = match &buffer.uri {
                Some(uri) => resource(uri, path).map_err(|why| format!("buffers[{i}]: {why}"))?,
                None => binary.take().ok_or_else(|| {
                    format!(
                        "buffers[{i}] has no uri, and there is no binary part that it could mean; give it one"
                    )
                })?,
            };
            if (found.len() as u64) < buffer.byte_length.0 {
                return Err(format!(
                    "buffers[{i}] is said to have {} bytes and has {}: the file is cut off",
                    buffer.byte_length.0,
                    found.len()
                ));
            }
            total += found.len() as u64;
            if total > MAX_OBJ_BYTES {
                return Err(format!("the buffers are larger than {} MiB together", MAX_OBJ_BYTES >> 20));
            }
            bytes.push(found);
        }
        Ok(Buffers { root, bytes })
    }

    /// The bytes of a view.
    pub fn view(&self, index: Index<buffer::View>) -> Read<&[u8]> {
        let i = index.value();
        let view = self.root.buffer_views.get(i).ok_or_else(|| format!("bufferViews[{i}] does not exist"))?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let end = start.checked_add(view.byte_length.0);
        let buffer = self.bytes.get(view.buffer.value());
        let range = usize::try_from(start).ok().zip(end.and_then(|end| usize::try_from(end).ok()));
        buffer
            .zip(range)
            .and_then(|(buffer, (start, end))| buffer.get(start..end))
            .ok_or_else(|| format!("bufferViews[{i}] reaches beyond its buffer"))
    }

    /// The numbers of an accessor, one element after the other, as `type_` has them. Normalised integers are 0 to 1, or
    /// -1 to 1.
    pub fn values(&self, index: Index<Accessor>, type_: Type) -> Read<Vec<f64>> {
        let i = index.value();
        let fault = |what: &str| format!("accessors[{i}] {what}");
        let accessor = self.root.accessors.get(i).ok_or_else(|| fault("does not exist"))?;
        let component = match accessor.component_type {
            gltf::json::validation::Checked::Valid(component) => component.0,
            gltf::json::validation::Checked::Invalid => return Err(fault("has numbers of an unknown kind")),
        };
        if !matches!(accessor.type_, gltf::json::validation::Checked::Valid(t) if t == type_) {
            return Err(fault("has not the type that it is used as"));
        }
        let (width, size) = (type_.multiplicity(), component.size());
        let count = usize::try_from(accessor.count.0).unwrap_or(usize::MAX);
        let most = count.checked_mul(width).filter(|n| *n <= MOST_VALUES);
        let total = most.ok_or_else(|| fault("has more values than can be read"))?;
        let number = |bytes: &[u8]| number(component, accessor.normalized, bytes);
        let element = size * width;
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let bytes = self.view(view)?;
                let stride = self.root.buffer_views[view.value()].byte_stride.map_or(element, |s| s.0);
                let offset = usize::try_from(accessor.byte_offset.map_or(0, |o| o.0)).unwrap_or(usize::MAX);
                let bytes = bytes.get(offset..).unwrap_or(&[]);
                let reaches =
                    count.saturating_sub(1).checked_mul(stride).and_then(|n| n.checked_add(element));
                if stride < size || count > 0 && reaches.is_none_or(|end| end > bytes.len()) {
                    return Err(fault("reaches beyond its bufferView"));
                }
                let mut values = Vec::with_capacity(total);
                for k in 0..count {
                    let of = &bytes[k * stride..k * stride + element];
                    values.extend(of.chunks_exact(size).map(number));
                }
                values
            }
            None if accessor.sparse.is_some() && count <= 1 << 24 => vec![0.0; total],
            None => {
                return Err(fault("has no bufferView: it may be compressed; export it without compression"));
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let gltf::json::validation::Checked::Valid(kind) = sparse.indices.component_type else {
                return Err(fault("has sparse indices of an unknown kind"));
            };
            let after = |view: Index<buffer::View>, offset: u64| {
                let bytes = self.view(view)?;
                let offset = usize::try_from(offset).unwrap_or(usize::MAX);
                bytes.get(offset..).ok_or_else(|| fault("reaches beyond its sparse bufferView"))
            };
            let places = after(sparse.indices.buffer_view, sparse.indices.byte_offset.0)?;
            let new = after(sparse.values.buffer_view, sparse.values.byte_offset.0)?;
            let (places, new) = (places.chunks_exact(kind.0.size()), new.chunks_exact(element));
            let sparse_count = usize::try_from(sparse.count.0).unwrap_or(usize::MAX);
            if places.len() < sparse_count || new.len() < sparse_count {
                return Err(fault("reaches beyond its sparse bufferView"));
            }
            for (place, new) in places.zip(new).take(sparse_count) {
                let at = self::number(kind.0, false, place) as usize * width;
                let old =
                    values.get_mut(at..at + width).ok_or_else(|| fault("has a sparse index out of range"))?;
                old.iter_mut().zip(new.chunks_exact(size)).for_each(|(old, new)| *old = number(new));
            }
        }
        Ok(values)
    }
}

/// One number, little-endian; `bytes` are as many as the kind has.
fn number(kind: ComponentType, normalised: bool, bytes: &[u8]) -> f64 {
    let two = || [bytes[0], bytes[1]];
    let four = || [bytes[0], bytes[1], bytes[2], bytes[3]];
    let (value, largest) = match kind {
        ComponentType::I8 => (f64::from(bytes[0] as i8), 127.0),
        ComponentType::U8 => (f64::from(bytes[0]), 255.0),
        ComponentType::I16 => (f64::from(i16::from_le_bytes(two())), 32767.0),
        ComponentType::U16 => (f64::from(u16::from_le_bytes(two())), 65535.0),
        ComponentType::U32 => (f64::from(u32::from_le_bytes(four())), 4294967295.0),
        ComponentType::F32 => return f64::from(f32::from_le_bytes(four())),
    };
    if normalised { f64::max(value / largest, -1.0) } else { value }
}

/// The bytes that a uri means: data in itself, or a file beside `path`.
pub fn resource(uri: &str, path: &Path) -> Read<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data
            .split_once(";base64,")
            .ok_or("a data uri in another form than base64 is not read; write it as base64")?;
        let engine = base64::engine::general_purpose::STANDARD;
        return engine.decode(text.trim()).map_err(|e| format!("the base64 of a data uri is damaged: {e}"));
    }
    if uri.contains("://") {
        return Err(format!("{}: only files beside the scene are read", short(uri)));
    }
    let file = beside(path, &unescaped(uri));
    read_bytes(&file, MAX_OBJ_BYTES).map_err(|why| format!("cannot read {}: {why}", file.display()))
}

/// A text that may be very long, for a message.
fn short(text: &str) -> String {
    text.chars().take(80).collect()
}

/// A uri with %20 and the like as what they mean; what they do not make text of stays.
fn unescaped(uri: &str) -> String {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex =
            uri.get(i + 1..i + 3).filter(|_| bytes[i] == b'%').and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(hex.unwrap_or(bytes[i]));
        i += if hex.is_some() { 3 } else { 1 };
    }
    String::from_utf8(out).unwrap_or_else(|_| uri.to_owned())
}

/// Textures by image: each is read once.
pub type Means = HashMap<usize, std::result::Result<super::texture::Mean, String>>;
