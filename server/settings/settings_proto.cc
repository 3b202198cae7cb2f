#include "server/settings/settings_proto.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/text_format.h>

#include "tessera/v1/jobs.pb.h"

namespace tessera {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::TextFormat;

// A field's value or values as text.
std::string Shown(const Message& message, const FieldDescriptor& field) {
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  std::string shown, value;
  if (!field.is_repeated()) {
    if (field.has_presence() && !reflection.HasField(message, &field)) return "not set";
    TextFormat::PrintFieldValueToString(message, &field, -1, &shown);
    return shown;
  }
  for (int i = 0; i < reflection.FieldSize(message, &field); ++i) {
    TextFormat::PrintFieldValueToString(message, &field, i, &value);
    shown += (i > 0 ? ", " : "") + value;
  }
  return shown.empty() ? "not set" : shown;
}

void AddDifferences(const Message& found, const Message& expected, const std::string& prefix,
                    std::vector<std::string>* differences) {
  for (int i = 0; i < found.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor& field = *found.GetDescriptor()->field(i);
    const std::string name = prefix + field.name();
    if (!field.is_repeated() && field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE) {
      AddDifferences(found.GetReflection()->GetMessage(found, &field),
                     expected.GetReflection()->GetMessage(expected, &field), name + ".", differences);
      continue;
    }
    const std::string here = Shown(found, field), there = Shown(expected, field);
    if (here != there) differences->push_back(name + ": found " + here + ", expected " + there);
  }
}

}  // namespace

std::vector<std::string> Differences(const JobSettings& found, const JobSettings& expected) {
  v1::JobSettings here, there;
  ToProto(found, &here);
  ToProto(expected, &there);
  std::vector<std::string> differences;
  AddDifferences(here, there, "", &differences);
  return differences;
}

JobSettings FromProto(const v1::JobSettings& proto) {
  JobSettings settings;
  settings.tiles = proto.tiles();
  settings.rounds = proto.rounds();
  settings.tile_memory_bytes = proto.tile_memory_bytes();
  if (!proto.method().empty()) settings.method = proto.method();
  const v1::MethodSettings& from = proto.method_settings();
  MethodSettings& to = settings.method_settings;
  if (from.has_semantic()) to.semantic = from.semantic();
  if (from.has_thin_plate()) to.thin_plate = from.thin_plate();
  if (from.has_inter()) to.inter = from.inter();
  if (from.has_contour()) to.contour = from.contour();
  if (from.has_normal_prior()) to.normal_prior = from.normal_prior();
  if (from.has_label_smoothness()) to.label_smoothness = from.label_smoothness();
  if (from.has_max_step_px()) to.max_step_px = from.max_step_px();
  if (from.has_window_px()) to.window_px = from.window_px();
  if (from.has_partners()) to.partners = from.partners();
  if (from.has_views_per_direction()) to.views_per_direction = from.views_per_direction();
  if (from.has_labels_first()) to.labels_first = from.labels_first();
  if (from.has_flip_edges()) to.flip_edges = from.flip_edges();
  to.levels.assign(from.levels().begin(), from.levels().end());
  to.iterations.assign(from.iterations().begin(), from.iterations().end());
  const v1::UpdateSettings& update = proto.update();
  settings.update = {update.base(),
                     {update.withdraw().begin(), update.withdraw().end()},
                     update.all_epochs(),
                     update.from_scratch(),
                     update.plan_only(),
                     update.rollback_to(),
                     {update.rollback_tiles().begin(), update.rollback_tiles().end()},
                     update.export_only()};
  settings.max_core_seconds = proto.max_core_seconds();
  settings.classifier = proto.classifier();
  settings.skip_images = proto.skip_images();
  settings.anyway = proto.anyway();
  settings.exports = FromProto(proto.export_());
  return settings;
}

ExportSettings FromProto(const v1::ExportSettings& proto) {
  return {{proto.formats().begin(), proto.formats().end()},
          proto.crs(),
          proto.color(),
          proto.gsd_m(),
          proto.class_materials()};
}

void ToProto(const ExportSettings& settings, v1::ExportSettings* proto) {
  proto->Clear();
  proto->mutable_formats()->Add(settings.formats.begin(), settings.formats.end());
  proto->set_crs(settings.crs);
  proto->set_color(settings.color);
  proto->set_gsd_m(settings.gsd_m);
  proto->set_class_materials(settings.class_materials);
}

void ToProto(const JobSettings& settings, v1::JobSettings* proto) {
  proto->Clear();
  proto->set_tiles(settings.tiles);
  proto->set_rounds(settings.rounds);
  proto->set_tile_memory_bytes(settings.tile_memory_bytes);
  proto->set_method(settings.method);
  proto->set_max_core_seconds(settings.max_core_seconds);
  proto->set_classifier(settings.classifier);
  proto->set_skip_images(settings.skip_images);
  proto->set_anyway(settings.anyway);
  if (const UpdateSettings& update = settings.update; !(update == UpdateSettings())) {
    v1::UpdateSettings& to = *proto->mutable_update();
    to.set_base(update.base);
    for (const std::string& flight : update.withdraw) to.add_withdraw(flight);
    to.set_all_epochs(update.all_epochs);
    to.set_from_scratch(update.from_scratch);
    to.set_plan_only(update.plan_only);
    to.set_rollback_to(update.rollback_to);
    to.mutable_rollback_tiles()->Add(update.rollback_tiles.begin(), update.rollback_tiles.end());
    to.set_export_only(update.export_only);
  }
  if (!(settings.exports == ExportSettings())) ToProto(settings.exports, proto->mutable_export_());
  const MethodSettings& from = settings.method_settings;
  if (from == MethodSettings()) return;
  v1::MethodSettings& to = *proto->mutable_method_settings();
  if (from.semantic) to.set_semantic(*from.semantic);
  if (from.thin_plate) to.set_thin_plate(*from.thin_plate);
  if (from.inter) to.set_inter(*from.inter);
  if (from.contour) to.set_contour(*from.contour);
  if (from.normal_prior) to.set_normal_prior(*from.normal_prior);
  if (from.label_smoothness) to.set_label_smoothness(*from.label_smoothness);
  if (from.max_step_px) to.set_max_step_px(*from.max_step_px);
  if (from.window_px) to.set_window_px(*from.window_px);
  if (from.partners) to.set_partners(*from.partners);
  if (from.views_per_direction) to.set_views_per_direction(*from.views_per_direction);
  if (from.labels_first) to.set_labels_first(*from.labels_first);
  if (from.flip_edges) to.set_flip_edges(*from.flip_edges);
  for (const int level : from.levels) to.add_levels(level);
  for (const int iterations : from.iterations) to.add_iterations(iterations);
}

}  // namespace tessera
