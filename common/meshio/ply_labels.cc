#include "common/meshio/ply_labels.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "common/meshio/text_words.h"

namespace tessera {
namespace {

// In lower case; names are compared without case.
constexpr std::array<std::string_view, 9> kOtherLabelNames = {"class",          "category_id",  "category",
                                                              "classification", "scalar_label", "scalar_classification",
                                                              "semantic",       "labels",       "label_id"};

constexpr char kUseOption[] = "the scene.json key \"label_property\" with the name of the one to use (null: none)";

const char* NameOf(PlyElementKind kind) { return kind == PlyElementKind::kFace ? "face" : "vertex"; }

Status LabelError(const std::string& file, int64_t line, const std::string& found, const std::string& expected) {
  return InputError(file, absl::StrCat("line ", line), found, expected);
}

PlyProperty* FindProperty(PlyElement& element, const std::string& property_name) {
  for (PlyProperty& property : element.properties) {
    if (property.name == property_name) return &property;
  }
  return nullptr;
}

// The property of `element` that holds labels by its name; null if there is none.
StatusOr<PlyProperty*> FindByKnownNames(const std::string& file, PlyElement& element) {
  if (PlyProperty* const label = FindProperty(element, "label")) {
    if (!label->is_list) return label;
    if (element.kind == PlyElementKind::kFace) {
      return LabelError(file, label->line, "face property 'label' that is a list", "'property int label'");
    }
  }
  std::vector<PlyProperty*> same, other;  // named label in another case; named as other programs do
  for (PlyProperty& property : element.properties) {
    if (property.is_list || property.role != PlyRole::kOther) continue;
    const std::string lower = absl::AsciiStrToLower(property.name);
    if (lower == "label") same.push_back(&property);
    if (std::find(kOtherLabelNames.begin(), kOtherLabelNames.end(), lower) != kOtherLabelNames.end()) {
      other.push_back(&property);
    }
  }
  const std::vector<PlyProperty*>& candidates = same.empty() ? other : same;
  if (candidates.empty()) return static_cast<PlyProperty*>(nullptr);
  if (candidates.size() > 1) {
    return LabelError(file, candidates[1]->line,
                      absl::StrCat(NameOf(element.kind), " properties ", Quoted(candidates[0]->name), " and ",
                                   Quoted(candidates[1]->name), ", which both may be the labels"),
                      kUseOption);
  }
  return candidates[0];
}

// The property of `element` with this name; null if there is none.
StatusOr<PlyProperty*> FindNamed(const std::string& file, const MeshReadOptions& options, PlyElement& element) {
  PlyProperty* const property = FindProperty(element, *options.label_property);
  if (property == nullptr || (!property->is_list && property->role == PlyRole::kOther)) return property;
  return LabelError(file, property->line,
                    absl::StrCat("property ", Quoted(property->name), ", which ", options.label_option),
                    "a property with one class index per face or vertex");
}

// Scalars of faces and vertices that may be labels, for a message.
std::string SomeProperties(const PlyHeader& header) {
  constexpr int kMost = 5;
  std::string names;
  int listed = 0;
  for (const PlyElement& element : header.elements) {
    if (element.kind == PlyElementKind::kOther) continue;
    for (const PlyProperty& property : element.properties) {
      if (property.is_list || property.role != PlyRole::kOther || ++listed > kMost) continue;
      absl::StrAppend(&names, names.empty() ? "" : ", ", Quoted(property.name));
    }
  }
  if (listed == 0) return "no other property that may be a label";
  return absl::StrCat("one of ", names, listed > kMost ? ", ..." : "");
}

}  // namespace

Status ChoosePlyLabels(const std::string& name, const MeshReadOptions& options, PlyHeader* header) {
  const std::optional<std::string>& label_property = options.label_property;
  if (label_property && label_property->empty()) return absl::OkStatus();
  for (const PlyElementKind kind : {PlyElementKind::kFace, PlyElementKind::kVertex}) {
    for (PlyElement& element : header->elements) {
      if (element.kind != kind) continue;
      TESSERA_ASSIGN_OR_RETURN(PlyProperty* const property,
                               label_property ? FindNamed(name, options, element) : FindByKnownNames(name, element));
      if (property == nullptr) continue;
      property->role = PlyRole::kLabel;
      header->labels = kind == PlyElementKind::kFace ? MeshLabels::kOfFaces : MeshLabels::kOfVertices;
      header->label_property = property->name;
      header->label_line = property->line;
      return absl::OkStatus();
    }
  }
  if (!label_property) return absl::OkStatus();
  return InputError(name, "header",
                    absl::StrCat("no property ", Quoted(*label_property), ", which ", options.label_option),
                    SomeProperties(*header));
}

}  // namespace tessera
