// Inspection of the pixel files of a scene: what their content is and whether they can be read. Tasks inspect some
// files each and write what they find; validation reads that instead of the files.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/base/task_control.h"
#include "common/check/label_findings.h"
#include "common/check/pixel_content.h"
#include "common/imaging/border_trust.h"
#include "common/imaging/image_header.h"
#include "common/imaging/likelihood_form.h"
#include "common/scene/scene.h"

namespace tessera {

// What the files of a view hold.
struct ViewInspection {
  StatusOr<PixelContent> content = PixelContent();
  Status broken;  // an error of the image; then `content` is empty
  BorderCounts borders = BorderCounts(0);
  LikelihoodDigest digest;
  std::string rgb = {};  // XXH3-128 hash of the colours as stored; empty: not read
};

// Decodes the files of the view, below `folder`, with likelihoods of `classes` classes.
ViewInspection InspectView(const std::string& folder, const SceneView& view, int classes);

// Each n-th view of a scene keeps LikelihoodDigest::classes, which JudgeLabels compares with the mesh's labels.
size_t ComparedStep(size_t views);

// The inspection of all pixel files in the folder of a scene of which other files may be missing. Errors of files are
// part of the result.
struct PartInspection {
  std::string json;         // for Inspections::Add
  bool has_faults = false;  // files cannot be read
};

// `load`: to_be_classified, all else default. White levels and the form of likelihoods are chosen from these files
// alone; where the whole scene has others, Inspections does not find its views. Does not depend on the number of
// threads. CANCELLED by `control`.
StatusOr<PartInspection> InspectPart(const std::string& folder, const SceneLoadOptions& load,
                                     const TaskControl& control);

// What inspections of parts of a scene found.
class Inspections {
 public:
  // `json`: of InspectPart; `folder`: of the scene, for its errors. INVALID_ARGUMENT.
  Status Add(const std::string& json, const std::string& folder);

  bool empty() const { return headers_.empty(); }
  // Lets LoadScene use the inspected files without opening them.
  void AddTo(SceneLoadOptions* load) const;
  // For ChooseWhiteLevels and FindLikelihoodForms.
  const std::map<std::string, int>& highest_samples() const { return highest_samples_; }
  const std::map<std::string, LabelContent>& label_contents() const { return label_contents_; }

  // Null if the files of the view were not inspected together, or with another lens, white level or form. `compared`:
  // the digest needs its classes.
  const ViewInspection* Find(const SceneView& view, int classes, bool compared = false) const;
  // The hash of the colours of the view's image; empty: unknown.
  std::string RgbOf(const SceneView& view) const;

 private:
  std::map<std::string, StatusOr<ImageHeader>> headers_;  // by path, relative to the scene, like the next two
  std::map<std::string, int> highest_samples_;
  std::map<std::string, LabelContent> label_contents_;
  std::map<std::string, ViewInspection> views_;  // by InspectionKey
  std::map<std::string, std::string> rgb_;       // by image_path and white level
};

// Inspections of a scene's pixel files, and how files that are not in its folder get there. By default there are no
// inspections, and all files are in the folder.
struct InspectedFiles {
  Inspections inspections = {};
  FetchFiles fetch = {};
};

// Makes those of `paths` that are not empty readable; they are relative to `folder`.
Status FetchInScene(const std::string& folder, const std::vector<std::string>& paths, const FetchFiles& fetch);

// Chooses white levels (ChooseWhiteLevels, with `is_read`) and the form of likelihoods (FindLikelihoodForms, with
// `known`) by what the inspections found, else by the files. CANCELLED; errors of fetching.
Status CompletePixelForms(const std::vector<uint8_t>& is_read, const std::map<std::string, LikelihoodForm>& known,
                          const InspectedFiles& files, const TaskControl& control, SceneDescription* scene,
                          Warnings* warnings);

}  // namespace tessera
