// node manifests.mjs FILE.yaml...: checks Kubernetes manifests, object by object:
// - against the types of kubernetes-models and @kubernetes-models/keda, by the TypeScript compiler: unknown fields and
//   wrong types are faults; and by their validators: required fields and formats;
// - pods against the rules of deploy/kubernetes/README.md.
// Prints the faults; exit code 1 if there are any.
import fs from 'node:fs';
import { createRequire } from 'node:module';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

const require = createRequire(import.meta.url);
const YAML = require('yaml');
const ts = require('typescript');

const faults = [];
const sources = new Map();  // TypeScript file of an object -> its name in messages
const folder = fs.mkdtempSync(path.join(path.dirname(fileURLToPath(import.meta.url)), '.manifests-'));

function modelOf({ apiVersion, kind }) {
  const group = apiVersion?.split('/')[0];
  const module = group === 'keda.sh' ? `@kubernetes-models/keda/${apiVersion}` : `kubernetes-models/${apiVersion}`;
  try {
    return { module, Model: require(module)[kind] };
  } catch {
    return {};
  }
}

function podSpecsOf(object) {
  const template = object.spec?.template ?? object.spec?.jobTargetRef?.template;
  return template ? [template.spec] : [];
}

function checkPod(name, pod) {
  const expect = (holds, rule) => holds || faults.push(`${name}: ${rule}`);
  expect(pod.automountServiceAccountToken === false, 'automountServiceAccountToken is not false');
  expect(pod.securityContext?.runAsNonRoot === true && pod.securityContext.runAsUser > 0, 'may run as root');
  expect(pod.securityContext?.seccompProfile?.type === 'RuntimeDefault', 'seccomp profile is not RuntimeDefault');
  for (const container of pod.containers) {
    const security = container.securityContext ?? {};
    const { requests = {}, limits = {} } = container.resources ?? {};
    expect(security.readOnlyRootFilesystem === true, 'root file system is not read-only');
    expect(security.allowPrivilegeEscalation === false, 'may escalate privileges');
    expect(security.capabilities?.drop?.includes('ALL') && !security.capabilities.add, 'has capabilities');
    expect(limits.memory && requests.memory === limits.memory, 'memory request and limit differ');
    const drain = container.args.find((argument) => argument.startsWith('--drain-s='))?.split('=')[1] ?? 5;
    expect(pod.terminationGracePeriodSeconds > Number(drain), 'grace period is not above --drain-s');
  }
  for (const volume of pod.volumes) {
    expect(!volume.emptyDir || volume.emptyDir.sizeLimit, `volume ${volume.name} has no size limit`);
  }
}

for (const file of process.argv.slice(2)) {
  for (const document of YAML.parseAllDocuments(fs.readFileSync(file, 'utf8'), { strict: true, uniqueKeys: true })) {
    faults.push(...document.errors.map((error) => `${file}: ${error.message}`));
    if (document.errors.length > 0) continue;
    const object = document.toJS();
    const name = `${file}: ${object.kind} ${object.metadata?.name}`;
    const { module, Model } = modelOf(object);
    if (!Model) {
      faults.push(`${name}: unknown kind of ${object.apiVersion}`);
      continue;
    }
    try {
      new Model(object).validate();
    } catch (error) {
      faults.push(`${name}: ${error.message}`);
    }
    podSpecsOf(object).forEach((pod) => checkPod(name, pod));
    const source = path.join(folder, `${sources.size}.ts`);
    fs.writeFileSync(source, `import type { I${object.kind} } from '${module}';\n` +
      `export const object: I${object.kind} = ${JSON.stringify(object)};\n`);
    sources.set(source, name);
  }
}
const program = ts.createProgram([...sources.keys()], {
  noEmit: true, strict: true, skipLibCheck: true, types: [],
  moduleResolution: ts.ModuleResolutionKind.Node10, module: ts.ModuleKind.CommonJS });
for (const fault of ts.getPreEmitDiagnostics(program)) {
  faults.push(`${sources.get(fault.file?.fileName)}: ${ts.flattenDiagnosticMessageText(fault.messageText, ' ')}`);
}
fs.rmSync(folder, { recursive: true });
faults.forEach((fault) => console.log(fault));
console.log(`${sources.size} objects, ${faults.length} faults`);
process.exit(faults.length > 0 || sources.size === 0 ? 1 : 0);
