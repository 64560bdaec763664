// Asks the Khronos glTF validator about models, such as a print's proof.glb. Prints a line a file, and exits with 1 if one
// has errors.
//
//     npm install gltf-validator
//     pellucid prepare model.glb --height-mm 10 --out print
//     node benches/peers/validate_gltf.mjs print/proof.glb

import { createRequire } from "node:module";
import { readFileSync } from "node:fs";

// From where the command runs, so that nothing needs to be installed beside this file.
const validator = createRequire(process.cwd() + "/")("gltf-validator");

let errors = 0;
for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 20 });
  const { numErrors, numWarnings, numInfos, messages } = report.issues;
  const { totalTriangleCount } = report.info;
  console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos; ${totalTriangleCount} triangles`);
  for (const { severity, code, message, pointer } of messages) {
    console.log(`  ${["error", "warning", "info", "hint"][severity]} ${code} at ${pointer}: ${message}`);
  }
  errors += numErrors;
}
process.exit(errors ? 1 : 0);
