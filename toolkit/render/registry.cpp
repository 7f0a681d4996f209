#include <palpate/registry.h>

#include <fmt/format.h>

#include <cassert>

namespace palpate::render {

std::vector<std::string> unsupported_features(const RendererInfo& info, const SceneInput& scene) {
  std::vector<std::string> sentences;
  for (const std::string& name : names_of(features_required_by(scene).without(info.supports)))
    sentences.push_back(
        fmt::format("{} renders no {}: what the scene says of it is left out.", info.name, name));
  return sentences;
}

void Registry::add(RendererInfo info) {
  assert(find(info.name) == nullptr);
  renderers_.push_back(std::move(info));
}

const RendererInfo* Registry::find(std::string_view name) const noexcept {
  for (const RendererInfo& info : renderers_)
    if (info.name == name) return &info;
  return nullptr;
}

Result<std::unique_ptr<HapticRenderer>> Registry::make(std::string_view name, const Options& options) const {
  const RendererInfo* info = find(name);
  if (info == nullptr) {
    std::string known;
    for (const RendererInfo& r : renderers_) known.append(known.empty() ? "" : ", ").append(r.name);
    return Error{fmt::format("there is no renderer '{}'", name), "choose from " + known, {}, 0};
  }
  Result<Options> complete = validate(options, info->options, name);
  if (!complete) return std::move(complete).error();
  return info->make(*complete);
}

Status Registry::check_supports(const RendererInfo& info, const SceneInput& scene) const {
  const Features asked = features_required_by(scene), missing = asked.without(info.supports);
  if (missing.empty()) return Done{};
  std::string able;
  for (const RendererInfo& r : renderers_)
    if (r.geometry != Geometry::kFormula && asked.without(r.supports).empty())
      able.append(able.empty() ? "" : ", ").append(r.name);
  return Error{fmt::format("the scene asks for {}, which {} does not render",
                           fmt::join(names_of(missing), " and "), info.name),
               able.empty() ? "no renderer has all that the scene asks for: take something out of it"
                            : "take it out of the scene, or choose from " + able,
               {},
               0};
}

}  // namespace palpate::render
