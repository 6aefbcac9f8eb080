// Bundles src/main.js with three.js into viewer.bundle.js: one script, no imports, nothing loaded later.
import { createHash } from 'node:crypto';
import { readdirSync, readFileSync, writeFileSync } from 'node:fs';
import { build } from 'esbuild';

const licence = readFileSync('node_modules/three/LICENSE', 'utf8').trim();
// Lets a test tell that the bundle is older than its sources.
const sources = createHash('sha256');
for (const name of readdirSync('src').sort()) sources.update(readFileSync(`src/${name}`));
const result = await build({
  entryPoints: ['src/main.js'],
  bundle: true,
  minify: true,
  format: 'iife',
  target: 'es2022',
  charset: 'utf8',
  legalComments: 'none', // the whole licence stands in the banner instead
  banner: { js: `/*\nThis script contains three.js, tree-shaken and minified.\nSources: ${sources.digest('hex')}\n\n${licence}\n*/` },
  write: false,
});
const text = result.outputFiles[0].text;
for (const forbidden of [/<\/script/i, /<!--/, /https?:\/\/(?!www\.w3\.org\/1999\/xhtml)/, /\bfetch\s*\(/, /XMLHttpRequest/, /\bimport\s*\(/]) {
  const hit = forbidden.exec(text);
  if (hit) {
    throw new Error(`viewer.bundle.js would hold ${forbidden}: …${text.slice(Math.max(0, hit.index - 80), hit.index + 80)}…`);
  }
}
writeFileSync('viewer.bundle.js', text);
console.log(`viewer.bundle.js: ${(text.length / 1024).toFixed(0)} kB`);
