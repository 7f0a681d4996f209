// A renderer written in Python, for the registry.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <palpate/registry.h>
#include "experiments/python/convert.h"
#include "experiments/python/scene_object.h"

namespace palpate::python {

/// A Python object with `prepare(scene)` and `step(hip, t)`, or a class of such, and the first exception that
/// came out of it. `step` answers None (free), a force, or (force, god object). Methods of other threads wait
/// for the interpreter's lock.
class PALPATE_HIDDEN PythonClass {
 public:
  /// Throws where the methods are missing.
  explicit PythonClass(py::object given);
  ~PythonClass();
  PythonClass(const PythonClass&) = delete;
  PythonClass& operator=(const PythonClass&) = delete;

  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  /// An object to be prepared; with the lock.
  [[nodiscard]] py::object make() const;
  void fail(Error error) {
    if (!failure_) failure_ = std::move(error);
  }
  [[nodiscard]] const std::optional<Error>& failure() const noexcept { return failure_; }
  void forget_failure() noexcept { failure_.reset(); }

 private:
  py::object given_;
  bool is_class_ = false;
  std::string name_;
  std::optional<Error> failure_;
};
using PythonClassPtr = std::shared_ptr<PythonClass>;

/// Everything that Palpate registers; made once.
[[nodiscard]] const render::Registry& our_renderers();
/// Adds the class under its name; throws where the name is taken. `scene` is what its prepare() gets.
void add_python_renderer(render::Registry& registry, const PythonClassPtr& python, ScenePtr scene);

}  // namespace palpate::python
