// Small grey pictures from the server, as canvases: 255 means saturated.

const kSaturated = 0xff3c1ee6;  // red, as the bytes of a pixel stand in memory: alpha, blue, green, red
const kGrey = Uint32Array.from({length: 256}, (_, v) => (0xff000000 | v << 16 | v << 8 | v) >>> 0);

/// picture: {width_px, height_px, grey_base64}
export function paint(canvas, picture, markSaturated) {
  const {width_px: w, height_px: h} = picture, text = atob(picture.grey_base64);
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const image = new ImageData(w, h), pixels = new Uint32Array(image.data.buffer), colour = kGrey.slice();
  if (markSaturated) colour[255] = kSaturated;
  for (let i = 0; i < pixels.length; ++i) pixels[i] = colour[text.charCodeAt(i)];
  canvas.getContext('2d').putImageData(image, 0, 0);
}
