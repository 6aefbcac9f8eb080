// Colour scale of the heightmap: dark is low, bright is high, also without colour vision.

const STOPS = ['#440154', '#482878', '#3e4989', '#31688e', '#26828e', '#1f9e89', '#35b779', '#6ece58', '#b5de2b', '#fde725'];
const PARTS = STOPS.map((stop) => [1, 3, 5].map((at) => Number.parseInt(stop.slice(at, at + 2), 16) / 255));

/** [red, green, blue], 0 to 1 in sRGB, of a share 0 to 1. */
export function heightColour(share) {
  const place = Math.min(1, Math.max(0, share)) * (PARTS.length - 1);
  const low = Math.min(PARTS.length - 2, Math.floor(place));
  return PARTS[low].map((value, k) => value + (PARTS[low + 1][k] - value) * (place - low));
}

export const heightGradient = `linear-gradient(to top, ${STOPS.join(', ')})`;
