// bundle.mjs OUTDIR: bundles src into OUTDIR/assets, with hashes in the names, and writes OUTDIR/index.html.
import { build } from 'esbuild';
import { readFileSync, rmSync, writeFileSync } from 'node:fs';
import { basename, join } from 'node:path';
import { gzipSync } from 'node:zlib';

const out = process.argv[2];
rmSync(join(out, 'assets'), { recursive: true, force: true });
const result = await build({
  entryPoints: ['src/main.ts', 'src/style.css', 'src/icon.svg'],
  outdir: join(out, 'assets'),
  bundle: true,
  splitting: true,
  minify: true,
  format: 'esm',
  target: ['es2022'],
  loader: { '.svg': 'copy' },
  entryNames: '[name]-[hash]',
  chunkNames: '[name]-[hash]',
  assetNames: '[name]-[hash]',
  metafile: true,
  legalComments: 'none',
  logLevel: 'warning',
});

const outputOf = {};
for (const [path, output] of Object.entries(result.metafile.outputs)) {
  if (output.entryPoint) outputOf[output.entryPoint] = basename(path);
  const bytes = readFileSync(path);
  console.log(`page: ${basename(path)} ${bytes.length} bytes, ${gzipSync(bytes, { level: 9 }).length} compressed`);
}
const page = readFileSync('src/index.html', 'utf8')
  .replace('SCRIPT', `assets/${outputOf['src/main.ts']}`)
  .replace('STYLE', `assets/${outputOf['src/style.css']}`)
  .replace('ICON', `assets/${outputOf['src/icon.svg']}`);
writeFileSync(join(out, 'index.html'), page);
