// The module palpate._palpate; the package palpate/ around it says what it is for.
#include "experiments/python/renderer_object.h"
#include "experiments/python/scene_object.h"
#include "experiments/session/version.h"

PYBIND11_MODULE(_palpate, module) {
  using namespace palpate::python;
  module.attr("__version__") = std::string(palpate::experiments::version_text());
  wait_at_exit();
  add_frame_type(module);
  add_scenes(module);
  add_paths(module);
  add_renderer(module);
  add_comparison(module);
}
