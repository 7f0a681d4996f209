#include <palpate/baselines.h>

#include "baselines/rivals.h"

#if __has_include(<CGAL/version.h>)
#include <CGAL/version.h>
#endif
#if __has_include(<embree3/rtcore_config.h>)
#include <embree3/rtcore_config.h>
#endif
#if __has_include(<OpenMesh/Core/System/config.h>)
#include <OpenMesh/Core/System/config.h>
#endif
#if __has_include(<pcl/pcl_config.h>)
#include <pcl/pcl_config.h>
#endif

// Text of a macro's value.
#define PALPATE_TEXT_OF(macro) #macro
#define PALPATE_TEXT(macro) PALPATE_TEXT_OF(macro)

namespace palpate::baselines {

void register_baseline_renderers(render::Registry& registry) {
  registry.add(cloud_vertices_info());
  registry.add(mesh_godobject_info());
  registry.add(penalty_grid_info());
  registry.add(sphere_proxy_info());
  registry.add(mesh_proxy_info());
  registry.add(stream_proxy_info());
  registry.add(mls_penalty_info());
  registry.add(mls_proxy_info());
  registry.add(vgraph_info());
  registry.add(vector_field_info());
  registry.add(sdf_godobject_info());
  registry.add(variable_proxy_info());
}

std::vector<std::pair<std::string, std::string>> library_versions() {
  std::vector<std::pair<std::string, std::string>> all;
#ifdef CGAL_VERSION
  all.emplace_back("CGAL", PALPATE_TEXT(CGAL_VERSION));
#endif
#ifdef RTC_VERSION_STRING
  all.emplace_back("Embree", RTC_VERSION_STRING);
#endif
#ifdef OM_VERSION
  all.emplace_back("OpenMesh", std::to_string(OM_GET_VER) + "." + std::to_string(OM_GET_MAJ) + "." +
                                   std::to_string(OM_GET_MIN));
#endif
#ifdef PCL_VERSION_PRETTY
  all.emplace_back("PCL", PCL_VERSION_PRETTY);
#endif
  return all;
}

}  // namespace palpate::baselines
