// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <memory>
#include <vector>

#include "cama/untangle.hpp"
#include "exact/face_tree.hpp"
#include "model/surface.hpp"

namespace cama::untangling {

/// An edge and a face that intersect.
struct Hit {
  int edge, face;
  double along;                    // of the edge, 0 to 1
  std::array<double, 3> weight;    // barycentric, in the face
};

/// direction . sum_k weight_k x_k >= target.
struct Push {
  std::array<int, 5> node{};
  std::array<double, 5> weight{};
  int count = 0;
  dvec3 direction{0, 0, 0};
  double target = 0;
  void add(int v, double w)
  {
    node[count] = v;
    weight[count++] = w;
  }
};

class Untangler {
public:
  Untangler(const Scene &scene, const Topology &topology, const UntangleOptions &options);
  UntangleReport run();
  const std::vector<dvec3> &positions() const { return x_; }

private:
  /// Vertices on one side of a contour, nearest first; sign: the side of the faces that their edges pierce.
  struct Side {
    std::vector<int> vertex;
    double area = 0;
    int rings = 0, sign = 0;
  };
  struct Near {
    Push push;
    double distance;
  };

  std::vector<Hit> audit() const;
  std::vector<int> contours(const std::vector<Hit> &hits) const;
  Sets sides(const std::vector<Hit> &hits) const;
  void push_out_of_obstacles(const std::vector<Hit> &hits, const Sets &side, std::vector<char> &done,
                             std::vector<Push> &pushes) const;
  std::array<Side, 2> sides_of_strand(const std::vector<Hit> &hits, const std::vector<int> &strand,
                                      const std::vector<char> &cut) const;
  void push_back(const std::vector<Hit> &hits, const std::vector<int> &contour, std::vector<char> &done,
                 std::vector<Push> &pushes) const;
  void push_side_back(const std::vector<Hit> &hits, const std::vector<int> &members, const std::vector<int> &strand,
                      const Side &side, std::vector<char> &done, std::vector<Push> &pushes) const;
  void shorten(const Hit &hit, std::vector<Push> &pushes) const;
  std::vector<Near> near() const;
  void touch(const std::vector<Push> &pushes);
  void apply(const std::vector<Push> &pushes, double stretch_stiffness);
  void satisfy(const Push &p);
  bool closed_hit(const Hit &h) const;

  const Topology &t_;
  Surface surface_;
  bool self_;
  int max_rounds_;
  double gap_;
  std::vector<dvec3> x_;
  std::vector<double> inverse_mass_, start_length_, limit_;
  std::vector<double> area_;
  std::vector<char> pushed_, active_, moved_;   // ever pushed; pushed or in a ring around; ever moved
  std::vector<int> obstacle_face_;
  std::vector<Triangle> obstacle_triangle_;
  std::unique_ptr<FaceTree> obstacle_tree_;
};

}  // namespace cama::untangling
