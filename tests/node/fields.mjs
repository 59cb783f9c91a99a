// Fields of decoded messages, so that they can be compared bit by bit.

/** The field of a decoded message at a path such as `command[1].epoch`. */
export function valueAt(message, path) {
  for (const part of path.match(/[a-z0-9_]+|\[\d+\]/g)) {
    message = part.startsWith("[") ? message[Number(part.slice(1, -1))] : message[part];
  }
  return message;
}

/** Integers, floating-point numbers as the integer of their bits. */
export function comparable(kind, value) {
  const values = typeof value === "object" ? Array.from(value) : [value];
  const view = new DataView(new ArrayBuffer(8));
  return values.map((number) => {
    if (kind === "float64") {
      view.setFloat64(0, number);
      return view.getBigUint64(0);
    }
    if (kind === "float32") {
      view.setFloat32(0, number);
      return BigInt(view.getUint32(0));
    }
    return BigInt(number);
  });
}

/** JavaScript may change the payload bits of a NaN. */
export function isNan(kind, bits) {
  if (kind === "float64") {
    return (bits & 0x7fffffffffffffffn) > 0x7ff0000000000000n;
  }
  return kind === "float32" && (bits & 0x7fffffffn) > 0x7f800000n;
}
