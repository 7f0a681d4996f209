// Scene keys for the origin and pose of points: poses, views, cleaning.
#include <cmath>

#include "toolkit/scene/scene_fields.h"

namespace palpate::scene {
namespace {

// A larger deviation from unit length is a mistake: four components with three digits are within 0.002.
constexpr double kQuaternionSlack = 0.01;

Status read_rotation(const toml::node& node, Eigen::Quaterniond& to, const TomlFile& in_file) {
  PALPATE_ASSIGN(const auto q, numbers<4>(node, "rotation", in_file));
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  if (std::abs(rotation.norm() - 1.0) > kQuaternionSlack)
    return in_file.at(node, fmt::format("'rotation' has length {:.6g}", rotation.norm()),
                      "a rotation is a unit quaternion w, x, y, z; [1, 0, 0, 0] is none");
  // Keeps an exact 1, 0, 0, 0 for is_identity().
  to = rotation.norm() == 1.0 ? rotation : rotation.normalized();
  return Done{};
}

Result<SceneCleaningStep> read_step(const toml::table& table, const TomlFile& in_file) {
  SceneCleaningStep clean;
  clean.line = static_cast<std::int64_t>(table.source().begin.line);
  for (const auto& [key, value] : table) {
    const std::string name(key.str());
    PALPATE_ASSIGN(const std::string given, option_text(value, name, in_file));
    if (name == "step")
      clean.step.name = given;
    else
      clean.step.options.set(name, given);
  }
  if (clean.step.name.empty())
    return in_file.at(table, "a [[model.clean]] needs 'step'", "step = \"outliers\"");
  return clean;
}

}  // namespace

Fields pose_fields(geometry::RigidTransform& pose) {
  return {field("position_mm", pose.translation_mm, kLengthsMm),
          {"rotation", [&pose](const toml::node& node, const std::string&, const TomlFile& in_file) {
             return read_rotation(node, pose.rotation, in_file);
           }}};
}

Fields view_fields(SceneView& view) {
  Fields fields = pose_fields(view.model_from_view);
  fields.push_back(file("cloud", view.cloud).must("cloud = \"second-view.ply\""));
  return fields;
}

Field clean_field(SceneModel& model) {
  return {"clean", [&model](const toml::node& node, const std::string&, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const auto tables, tables_of(node, "model.clean", in_file));
            for (const toml::table* table : tables) {
              PALPATE_ASSIGN(SceneCleaningStep clean, read_step(*table, in_file));
              model.clean.push_back(std::move(clean));
            }
            return Done{};
          }};
}

}  // namespace palpate::scene
