// A SurfaceMesh of points in a raster, as depth images are: the raster gives the neighbours, so that nothing
// is welded, sorted or searched.
#include <cmath>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

SurfaceMesh SurfaceMesh::of_raster(const RasterSheet& sheet, const Vec3& origin_mm) {
  SurfaceMesh mesh;
  mesh.origin_mm_ = origin_mm;
  const auto columns = static_cast<std::uint32_t>(sheet.columns);
  const auto rows = static_cast<std::uint32_t>(columns == 0 ? 0 : sheet.at_mm.size() / columns);
  // The first facet of each square, and each pixel's vertex.
  LargePageUninitializedVector<std::uint32_t> first(sheet.at_mm.size()), vertex(sheet.at_mm.size());
  std::uint32_t facets = 0, vertices = 0;
  for (std::size_t pixel = 0; pixel < sheet.at_mm.size(); ++pixel) {
    vertex[pixel] = sheet.measured[pixel] != 0 ? vertices++ : kNoFacet;
    first[pixel] = sheet.square[pixel] != 0 ? facets : kNoFacet;
    facets += sheet.square[pixel] != 0 ? 2u : 0u;
  }
  mesh.vertices_.resize(vertices);
  mesh.facets_.resize(facets);
  mesh.stars_.begin.resize(vertices + 1);
  mesh.stars_.items.resize(3 * std::size_t{facets});
  std::uint32_t listed = 0;
  const auto facet_at = [&](std::uint32_t column, std::uint32_t row, std::uint32_t which) {
    if (column >= columns || row >= rows) return kNoFacet;  // -1 wraps around
    const std::uint32_t facet = first[row * columns + column];
    return facet == kNoFacet ? kNoFacet : facet + which;
  };
  const auto over = [](std::uint32_t facet) { return facet == kNoFacet ? kNoFacet : half_facet(facet, 0); };
  for (std::uint32_t row = 0; row < rows; ++row)
    for (std::uint32_t column = 0; column < columns; ++column) {
      const std::uint32_t a = row * columns + column;
      if (vertex[a] == kNoFacet) continue;
      mesh.vertices_[vertex[a]] = sheet.at_mm[a];
      mesh.stars_.begin[vertex[a]] = listed;
      // A square's upper left facet has its corners a, d, b, its lower right one b, d, e, facing the camera:
      //   a b
      //   d e
      for (const std::uint32_t facet :
           {facet_at(column - 1, row - 1, 1), facet_at(column, row - 1, 0), facet_at(column, row - 1, 1),
            facet_at(column - 1, row, 0), facet_at(column - 1, row, 1), facet_at(column, row, 0)})
        if (facet != kNoFacet) mesh.stars_.items[listed++] = facet;
      if (first[a] == kNoFacet) continue;
      const std::uint32_t b = a + 1, d = a + columns, e = d + 1, upper = first[a], lower = upper + 1;
      mesh.facets_[upper] = {
          {sheet.at_mm[a], sheet.at_mm[d], sheet.at_mm[b]},
          {vertex[a], vertex[d], vertex[b]},
          {over(facet_at(column - 1, row, 1)), over(lower), over(facet_at(column, row - 1, 1))}};
      mesh.facets_[lower] = {
          {sheet.at_mm[b], sheet.at_mm[d], sheet.at_mm[e]},
          {vertex[b], vertex[d], vertex[e]},
          {over(upper), over(facet_at(column, row + 1, 0)), over(facet_at(column + 1, row, 0))}};
      for (const std::uint32_t corner : {a, b, d, e}) mesh.box_.add(sheet.at_mm[corner]);
    }
  mesh.stars_.begin[vertices] = listed;
  mesh.counts_.vertices = vertices;
  mesh.counts_.largest_fan = facets > 0 ? kRasterFan : 0;
  if (facets > 0) {
    geometry::Aabb numbers = mesh.box_;
    numbers.add(Vec3::Zero());
    mesh.rounding_mm_ = rounding_of(numbers);
  }
  return mesh;
}

}  // namespace palpate::baselines
