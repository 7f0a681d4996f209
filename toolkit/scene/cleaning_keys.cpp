// The keys of a scene about where points come from and stand: poses, further views, cleaning.
#include <filesystem>

#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {
namespace {

// A rotation whose length differs from 1 by more than this is a mistake, not rounding: four components
// written with three digits are within 0.002.
constexpr double kQuaternionSlack = 0.01;

}  // namespace

Status read_pose(const toml::table& table, geometry::RigidTransform& pose, const InFile& in_file) {
  if (const toml::node* node = table.get("position_mm")) {
    const auto p = numbers<3>(*node, "position_mm", in_file);
    if (!p) return p.error();
    pose.translation_mm = Vec3((*p)[0], (*p)[1], (*p)[2]);
  }
  if (const toml::node* node = table.get("rotation")) {
    const auto q = numbers<4>(*node, "rotation", in_file);
    if (!q) return q.error();
    const Eigen::Quaterniond rotation((*q)[0], (*q)[1], (*q)[2], (*q)[3]);
    if (std::abs(rotation.norm() - 1.0) > kQuaternionSlack)
      return in_file.at(*node, fmt::format("'rotation' has length {:.6g}", rotation.norm()),
                        "a rotation is a unit quaternion w, x, y, z; [1, 0, 0, 0] is none");
    // Exactly 1, 0, 0, 0 stays so, for is_identity().
    pose.rotation = rotation.norm() == 1.0 ? rotation : rotation.normalized();
  }
  return Done{};
}

Status read_views(const toml::table& model_table, SceneModel& model, const InFile& in_file) {
  const Result<std::vector<const toml::table*>> tables = tables_of(model_table, "view", in_file);
  if (!tables) return tables.error();
  for (const toml::table* table : *tables) {
    if (const Status keys =
            check_keys(*table, {"cloud", "position_mm", "rotation"}, {}, "[[model.view]]", in_file);
        !keys)
      return keys.error();
    const toml::node* file = table->get("cloud");
    if (file == nullptr)
      return in_file.at(*table, "a [[model.view]] needs 'cloud'", "cloud = \"second-view.ply\"");
    const Result<std::string> name = text(*file, "cloud", in_file);
    if (!name) return name.error();
    SceneView view;
    view.cloud = (std::filesystem::path(in_file.file).parent_path() / *name).lexically_normal().string();
    if (const Status pose = read_pose(*table, view.model_from_view, in_file); !pose) return pose.error();
    model.views.push_back(std::move(view));
  }
  return Done{};
}

Status read_clean(const toml::table& model_table, SceneModel& model, const InFile& in_file) {
  const Result<std::vector<const toml::table*>> tables = tables_of(model_table, "clean", in_file);
  if (!tables) return tables.error();
  for (const toml::table* table : *tables) {
    SceneClean clean;
    clean.line = static_cast<std::int64_t>(table->source().begin.line);
    for (const auto& [key, value] : *table) {
      const std::string name(key.str());
      const Result<std::string> given = option_text(value, name, in_file);
      if (!given) return given.error();
      if (name == "step")
        clean.step.name = *given;
      else
        clean.step.options.set(name, *given);
    }
    if (clean.step.name.empty())
      return in_file.at(*table, "a [[model.clean]] needs 'step'", "step = \"outliers\"");
    model.clean.push_back(std::move(clean));
  }
  return Done{};
}

}  // namespace palpate::scene
