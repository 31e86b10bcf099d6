// TriangleTiles: the obstacles' triangles as one FCL model per square of the plane, each with all that a robot whose
// reference point lies in the square can meet. What is far away is left out by one look-up, where a single model of
// the whole world spends most of its time on the upper part of its tree of oriented boxes.
#pragma once

#include <algorithm>
#include <cstddef>
#include <fcl/fcl.h>
#include <memory>
#include <vector>

#include "problem.hpp"

namespace trailmark {

using Mesh = fcl::BVHModel<fcl::OBBRSSd>;

// Flat triangles at z = 0 that fill their regions: so FCL is exact, containment included (a surface alone would miss
// a robot wholly inside an obstacle, and primitives against meshes give wrong answers).
std::shared_ptr<Mesh> mesh_of(const std::vector<Triangle>& triangles);

class TriangleTiles {
 public:
  // most: tiles along each side at most; 1 makes a single model. No tile is smaller than the robot's circumradius.
  // margin: metres from the robot within which a tile holds all that it may be near to, too.
  TriangleTiles(const Problem& problem, std::size_t most, double margin = 0.0);

  // The triangles near (x, y), which lies within the bounds; null if there are none.
  const Mesh* near(double x, double y) const { return tiles_[row(y) * columns_ + column(x)].get(); }

 private:
  std::size_t column(double x) const { return index((x - x0_) * per_metre_, columns_); }
  std::size_t row(double y) const { return index((y - y0_) * per_metre_, rows_); }
  static std::size_t index(double value, std::size_t count) {
    return value > 0.0 ? std::min(static_cast<std::size_t>(value), count - 1) : 0;
  }

  double x0_, y0_, per_metre_;
  std::size_t columns_, rows_;
  std::vector<std::shared_ptr<Mesh>> tiles_;
};

}  // namespace trailmark
