// Shows surfaces and volumes in an element: drag turns, two fingers or + and − zoom, switches hide layers.
function showPanel(root, scene) {
  "use strict";
  var canvas = root.querySelector("canvas"), box = canvas.parentNode, gl = null;
  try { gl = canvas.getContext("webgl2", { antialias: true, alpha: false }); } catch (error) { gl = null; }
  if (!gl) { return false; }
  root.querySelector(".missing").hidden = true;
  root.querySelector(".live").hidden = false;

  function bytes(text) { return Uint8Array.from(atob(text), function (letter) { return letter.charCodeAt(0); }); }
  function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }
  function unit(a) { var n = Math.sqrt(dot(a, a)) || 1; return a.map(function (x) { return x / n; }); }
  function make(tag, parent, text, name) {
    var made = document.createElement(tag);
    if (text) { made.textContent = text; }
    if (name) { made.className = name; }
    return parent.appendChild(made);
  }

  // Programs: surfaces with two lights of the camera, and planes with a picture of the volumes.
  function program(vertex, fragment) {
    var made = gl.createProgram();
    [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]].forEach(function (each) {
      var shader = gl.createShader(each[0]);
      gl.shaderSource(shader, "#version 300 es\nprecision highp float;\n" + each[1]);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) { throw new Error(gl.getShaderInfoLog(shader)); }
      gl.attachShader(made, shader);
    });
    ["point", "normal", "value"].forEach(function (name, i) { gl.bindAttribLocation(made, i, name); });
    gl.linkProgram(made);
    return made;
  }
  var camera = "uniform vec3 centre, right, up, toward; uniform vec3 half_size; uniform float lift;\n" +
    "vec4 project(vec3 p) { vec3 d = p - centre;\n" +
    "return vec4(dot(d, right) / half_size.x, dot(d, up) / half_size.y, -dot(d, toward) / half_size.z - lift, 1.0); }\n";
  var solid = program(camera + "uniform vec3 low, size; in vec3 point, normal; in float value; out vec3 n, at; out float v;\n" +
    "void main() { at = low + size * point; n = normal; v = value; gl_Position = project(at); }",
    "uniform vec3 right, up, toward, colour; uniform vec4 cut; uniform float opacity, valued, lit; uniform sampler2D palette;\n" +
    "in vec3 n, at; in float v; out vec4 shown;\n" +
    "void main() { if (dot(cut.xyz, at) > cut.w) discard;\n" +
    "vec3 c = valued > 0.5 ? texture(palette, vec2((v * 255.0 + 0.5) / 256.0, 0.5)).rgb : colour;\n" +
    // At sharp edges and on coarse triangles the triangle's own normal.
    "vec3 g = normalize(cross(dFdx(at), dFdy(at)) + 1e-20), s = normalize(n + 1e-20); if (abs(dot(g, s)) < 0.92) s = g;\n" +
    "vec3 m = normalize(vec3(dot(s, right), dot(s, up), dot(s, toward)) + 1e-6); if (m.z < 0.0) m = -m;\n" +
    "float light = 0.30 + 0.62 * max(dot(m, normalize(vec3(-0.45, 0.55, 0.70))), 0.0)" +
    " + 0.22 * max(dot(m, normalize(vec3(0.6, -0.1, 0.79))), 0.0);\n" +
    "float alpha = opacity < 1.0 ? opacity + (1.0 - opacity) * pow(1.0 - m.z, 2.5) : 1.0;\n" +
    "shown = vec4(c * mix(1.0, light, lit), lit > 0.5 ? alpha : opacity); }");
  var flat = program(camera + "in vec3 point; in vec2 normal; out vec2 t; void main() { t = normal; gl_Position = project(point); }",
    "uniform sampler2D picture; in vec2 t; out vec4 shown; void main() { shown = texture(picture, t); if (shown.a < 0.02) discard; }");
  function uniform(of, name) { return gl.getUniformLocation(of, name); }

  function buffer(data, kind) {
    var made = gl.createBuffer();
    gl.bindBuffer(kind || gl.ARRAY_BUFFER, made);
    gl.bufferData(kind || gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return made;
  }
  function texture(width, height, data, smooth) {
    var made = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, made);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, data);
    [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T].forEach(function (side) { gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE); });
    [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER].forEach(function (size) {
      gl.texParameteri(gl.TEXTURE_2D, size, smooth ? gl.LINEAR : gl.NEAREST);
    });
    return made;
  }

  var low = scene.low, size = [0, 1, 2].map(function (k) { return scene.high[k] - scene.low[k]; });
  var shapes = scene.shapes.map(function (shape) {
    var points = new Uint16Array(bytes(shape.points).buffer), triangles = new Uint32Array(bytes(shape.triangles).buffer);
    var normals = new Float32Array(points.length), edges = new Uint32Array(2 * triangles.length), n = 0, seen = new Set();
    function at(i) { return [0, 1, 2].map(function (k) { return size[k] * points[3 * i + k] / 65535; }); }
    for (var t = 0; t < triangles.length; t += 3) {
      var p = at(triangles[t]), q = at(triangles[t + 1]), r = at(triangles[t + 2]);
      var normal = cross([0, 1, 2].map(function (k) { return q[k] - p[k]; }), [0, 1, 2].map(function (k) { return r[k] - p[k]; }));
      for (var c = 0; c < 3; c += 1) {
        var a = triangles[t + c], b = triangles[t + (c + 1) % 3], key = Math.min(a, b) * 4294967 + Math.max(a, b);
        for (var k = 0; k < 3; k += 1) { normals[3 * a + k] += normal[k]; }
        if (shape.edges && !seen.has(key)) { seen.add(key); edges[n] = a; edges[n + 1] = b; n += 2; }
      }
    }
    for (var i = 0; i < normals.length; i += 3) { normals.set(unit([normals[i], normals[i + 1], normals[i + 2]]), i); }
    return {
      list: points, points: buffer(points), normals: buffer(normals), triangles: buffer(triangles, gl.ELEMENT_ARRAY_BUFFER), count: triangles.length,
      edges: shape.edges ? buffer(edges.subarray(0, n), gl.ELEMENT_ARRAY_BUFFER) : null, edge_count: n
    };
  });
  var scales = scene.scales.map(function (scale) {
    var colours = bytes(scale.colours);
    return { colours: colours, texture: texture(256, 1, colours, false), label: scale.label, low: scale.low, high: scale.high };
  });
  scene.surfaces.forEach(function (each) { if (each.values) { each.buffer = buffer(bytes(each.values)); } });
  scene.volumes.forEach(function (each) { each.bytes = bytes(each.values); });

  // Volumes: every plane through the cursor has one picture, in which the shown volumes lie over each other.
  var cursor = scene.focus.slice(), planes = [null, null, null], planes_on = scene.volumes.length > 0, stale = true;
  var finest = Math.min.apply(null, scene.volumes.map(function (each) { return Math.min.apply(null, each.spacing); }));
  var ends = [0, 1, 2].map(function (k) {
    var a = scene.volumes.map(function (each) { return each.origin[k] - each.spacing[k] / 2; });
    var b = scene.volumes.map(function (each) { return each.origin[k] + (each.shape[k] - 0.5) * each.spacing[k]; });
    return [Math.min.apply(null, a), Math.max.apply(null, b)];
  });
  function picture(axis) {
    var u = (axis + 1) % 3, v = (axis + 2) % 3;
    var wide = Math.max(1, Math.min(512, Math.round((ends[u][1] - ends[u][0]) / finest)));
    var tall = Math.max(1, Math.min(512, Math.round((ends[v][1] - ends[v][0]) / finest)));
    var found = new Uint8Array(4 * wide * tall), at = [0, 0, 0];
    at[axis] = cursor[axis];
    scene.volumes.filter(function (each) { return each.shown; }).forEach(function (each) {
      var colours = scales[each.scale].colours;
      function index(k) { return Math.round((at[k] - each.origin[k]) / each.spacing[k]); }
      for (var j = 0; j < tall; j += 1) {
        at[v] = ends[v][0] + (j + 0.5) * (ends[v][1] - ends[v][0]) / tall;
        for (var i = 0; i < wide; i += 1) {
          at[u] = ends[u][0] + (i + 0.5) * (ends[u][1] - ends[u][0]) / wide;
          var n = [index(0), index(1), index(2)];
          if (n.some(function (x, k) { return x < 0 || x >= each.shape[k]; })) { continue; }
          var value = each.bytes[(n[0] * each.shape[1] + n[1]) * each.shape[2] + n[2]];
          if (value === 0) { continue; }
          var place = 4 * (j * wide + i), old = found[place + 3] / 255, alpha = each.opacity, both = alpha + (1 - alpha) * old;
          for (var k = 0; k < 3; k += 1) {
            found[place + k] = (alpha * colours[4 * value + k] + (1 - alpha) * old * found[place + k]) / both;
          }
          found[place + 3] = 255 * both;
        }
      }
    });
    var corners = [[0, 0], [1, 0], [0, 1], [1, 1]], points = [];
    corners.forEach(function (corner) {
      var p = [0, 0, 0];
      p[axis] = cursor[axis]; p[u] = ends[u][corner[0]]; p[v] = ends[v][corner[1]];
      points = points.concat(p);
    });
    if (planes[axis]) { gl.deleteTexture(planes[axis].picture); gl.deleteBuffer(planes[axis].points); }
    planes[axis] = {
      picture: texture(wide, tall, found, true), points: buffer(new Float32Array(points)),
      corners: buffer(new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]))
    };
  }

  // The camera turns about the vertical.
  var centre = [0, 1, 2].map(function (k) { return low[k] + size[k] / 2; }), reach = Math.sqrt(dot(size, size)) / 2 || 1;
  var start = unit(scene.toward), azimuth, height, zoom, pan = false, side = 0;
  function reset() { look(start); zoom = 1; }
  var wanted = [0, 0];  // half width and half height of everything in the first view
  (function () {
    var right = unit([-start[1], start[0], 1e-9]), up = cross(start, right);
    function add(p) {
      var d = p.map(function (x, k) { return x - centre[k]; });
      wanted = [Math.max(wanted[0], Math.abs(dot(d, right))), Math.max(wanted[1], Math.abs(dot(d, up)))];
    }
    shapes.forEach(function (shape) {
      for (var i = 0; i < shape.list.length; i += 3) {
        add([0, 1, 2].map(function (k) { return low[k] + size[k] * shape.list[i + k] / 65535; }));
      }
      shape.list = null;
    });
    if (scene.volumes.length || !shapes.length) { wanted = wanted.map(function (x) { return Math.max(x, 0.75 * reach); }); }
  }());
  function look(toward) { azimuth = Math.atan2(toward[1], toward[0]); height = Math.asin(Math.max(-1, Math.min(1, toward[2]))); }
  reset();
  var letters = scene.head ? ["R", "A", "S"] : ["x", "y", "z"];
  var tags = letters.map(function (letter) { return make("span", box, letter, "axis-name"); });
  box.insertAdjacentHTML("beforeend", "<svg><line/><line/><line/></svg>");
  var lines = Array.from(box.querySelectorAll("line"));

  function draw() {
    pan = false;
    var ratio = Math.min(window.devicePixelRatio || 1, 2), wide = box.clientWidth, tall = box.clientHeight;
    if (!wide || !tall) { return; }
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(tall * ratio)) {
      canvas.width = Math.round(wide * ratio); canvas.height = Math.round(tall * ratio);
    }
    var toward = [Math.cos(azimuth) * Math.cos(height), Math.sin(azimuth) * Math.cos(height), Math.sin(height)];
    var right = [-Math.sin(azimuth), Math.cos(azimuth), 0], up = cross(toward, right);
    var scale = 1.06 * Math.max(wanted[0] / wide, wanted[1] / tall) / zoom || 1, half = [scale * wide, scale * tall, 4 * reach];
    var cut = [0, 0, 0, 1];
    if (side) { var axis = Math.abs(side) - 1; cut[axis] = Math.sign(side); cut[3] = Math.sign(side) * cursor[axis]; }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(1, 1, 1, 1);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    function view(of, lift) {
      gl.useProgram(of);
      gl.uniform3fv(uniform(of, "centre"), centre); gl.uniform3fv(uniform(of, "right"), right);
      gl.uniform3fv(uniform(of, "up"), up); gl.uniform3fv(uniform(of, "toward"), toward);
      gl.uniform3fv(uniform(of, "half_size"), half); gl.uniform1f(uniform(of, "lift"), lift);
    }
    function attribute(i, data, count, kind, scaled) {
      gl.bindBuffer(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, count, kind, scaled, 0, 0);
    }
    function surface(each) {
      var shape = shapes[each.shape];
      view(solid, each.edges ? 0.0004 : 0);
      gl.uniform3fv(uniform(solid, "low"), low); gl.uniform3fv(uniform(solid, "size"), size);
      gl.uniform3fv(uniform(solid, "colour"), each.colour); gl.uniform1f(uniform(solid, "opacity"), each.opacity);
      gl.uniform1f(uniform(solid, "lit"), each.edges ? 0 : 1); gl.uniform1f(uniform(solid, "valued"), each.buffer ? 1 : 0);
      gl.uniform4fv(uniform(solid, "cut"), each.whole ? [0, 0, 0, 1] : cut);
      attribute(0, shape.points, 3, gl.UNSIGNED_SHORT, true);
      attribute(1, shape.normals, 3, gl.FLOAT, false);
      if (each.buffer) {
        attribute(2, each.buffer, 1, gl.UNSIGNED_BYTE, true);
        gl.bindTexture(gl.TEXTURE_2D, scales[each.scale].texture);
      } else { gl.disableVertexAttribArray(2); }
      gl.depthMask(each.opacity >= 1);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, each.edges ? shape.edges : shape.triangles);
      gl.drawElements(each.edges ? gl.LINES : gl.TRIANGLES, each.edges ? shape.edge_count : shape.count, gl.UNSIGNED_INT, 0);
    }
    var shown = scene.surfaces.filter(function (each) { return each.shown; });
    shown.filter(function (each) { return each.opacity >= 1; }).forEach(surface);
    if (planes_on && scene.volumes.some(function (each) { return each.shown; })) {
      view(flat, 0);
      gl.depthMask(true);
      gl.disableVertexAttribArray(2);
      [0, 1, 2].forEach(function (axis) {
        if (stale === true || stale === axis) { picture(axis); }
        attribute(0, planes[axis].points, 3, gl.FLOAT, false);
        attribute(1, planes[axis].corners, 2, gl.FLOAT, false);
        gl.bindTexture(gl.TEXTURE_2D, planes[axis].picture);
        gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      });
      stale = false;
    }
    shown.filter(function (each) { return each.opacity < 1; }).forEach(surface);
    tags.forEach(function (tag, k) {
      var x = 50 + 38 * right[k], y = tall - 50 - 38 * up[k];
      lines[k].setAttribute("x1", 50); lines[k].setAttribute("y1", 50);
      lines[k].setAttribute("x2", 50 + 27 * right[k]); lines[k].setAttribute("y2", 50 - 27 * up[k]);
      tag.style.left = x + "px"; tag.style.top = y + "px"; tag.style.opacity = toward[k] < -0.9 ? 0.25 : 1;
    });
  }
  function later() { if (!pan) { pan = true; window.requestAnimationFrame(draw); } }

  // Switches, planes, cut, keys of the colours.
  var switches = root.querySelector(".switches"), places = root.querySelector(".places"), keys = root.querySelector(".scales");
  function legend() {
    keys.textContent = "";
    var used = scene.surfaces.concat(scene.volumes).filter(function (each) { return each.shown && each.scale !== null; });
    scales.forEach(function (scale, number) {
      if (!scale.label || !used.some(function (each) { return each.scale === number; })) { return; }
      var item = make("div", keys), stops = [];
      for (var i = 1; i < 256; i += 6) { stops.push("rgb(" + Array.from(scale.colours.subarray(4 * i, 4 * i + 3)).join(",") + ")"); }
      make("small", item, scale.label);
      make("i", item).style.background = "linear-gradient(90deg," + stops.join(",") + ")";
      var both = make("small", item, "", "both");
      make("span", both, scale.low); make("span", both, scale.high);
    });
  }
  scene.surfaces.concat(scene.volumes).forEach(function (each) {
    var label = make("label", switches), input = make("input", label), mark = make("span", label, "", "swatch");
    input.type = "checkbox"; input.checked = each.shown;
    mark.style.background = each.scale === null ? "rgb(" + each.colour.map(function (x) { return Math.round(255 * x); }).join(",") + ")" : "linear-gradient(90deg,rgb(" +
      [20, 128, 240].map(function (i) { return Array.from(scales[each.scale].colours.subarray(4 * i, 4 * i + 3)).join(","); }).join("),rgb(") + "))";
    make("span", label, each.name);
    input.addEventListener("change", function () { each.shown = input.checked; stale = true; legend(); later(); });
  });
  [0, 1, 2].forEach(function (k) {
    var label = make("label", places, letters[k] + " "), input = make("input", label), said = make("output", label);
    input.type = "range"; input.min = low[k]; input.max = low[k] + size[k]; input.step = size[k] / 400 || 1; input.value = cursor[k];
    input.setAttribute("aria-label", "Plane along " + letters[k]);
    function tell() { said.textContent = (1000 * cursor[k]).toFixed(1).replace(/^-0.0$/, "0.0").replace("-", "−") + " mm"; }
    input.addEventListener("input", function () { cursor[k] = Number(input.value); stale = stale === false ? k : true; tell(); later(); });
    tell();
  });
  var names = scene.head ? ["right", "front", "upper"] : ["+x", "+y", "+z"];
  var others = scene.head ? ["left", "back", "lower"] : ["−x", "−y", "−z"];
  var chosen = make("select", make("label", places, "Cut away "));
  [["nothing", 0]].concat(names.map(function (name, k) { return [name + " part", k + 1]; }))
    .concat(others.map(function (name, k) { return [name + " part", -k - 1]; }))
    .forEach(function (each) { make("option", chosen, each[0]).value = each[1]; });
  chosen.value = side = scene.cut;
  chosen.addEventListener("change", function () { side = Number(chosen.value); later(); });
  var faces = scene.head ? [["Front", [0, 1, 0]], ["Right", [1, 0, 0]], ["Top", [0, 0.001, 1]]]
    : [["From −y", [0, -1, 0]], ["From +x", [1, 0, 0]], ["Top", [0, -0.001, 1]]];
  faces.forEach(function (face) {
    make("button", places, face[0]).addEventListener("click", function () { look(unit(face[1])); later(); });
  });
  [["+", 1.25], ["−", 0.8]].forEach(function (each) {
    make("button", places, each[0]).addEventListener("click", function () { zoom *= each[1]; later(); });
  });
  make("button", places, "Reset").addEventListener("click", function () { reset(); later(); });
  Array.from(places.querySelectorAll("button")).forEach(function (button) { button.type = "button"; });

  var held = new Map(), apart = 0;
  function turn(x, y) { azimuth -= 0.008 * x; height = Math.max(-1.57, Math.min(1.57, height + 0.008 * y)); later(); }
  canvas.addEventListener("pointerdown", function (event) { held.set(event.pointerId, [event.clientX, event.clientY]); apart = 0; canvas.setPointerCapture(event.pointerId); });
  ["pointerup", "pointercancel"].forEach(function (name) { canvas.addEventListener(name, function (event) { held.delete(event.pointerId); apart = 0; }); });
  canvas.addEventListener("pointermove", function (event) {
    var before = held.get(event.pointerId);
    if (!before) { return; }
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (held.size === 1) { turn(event.clientX - before[0], event.clientY - before[1]); return; }
    var two = Array.from(held.values()), now = Math.hypot(two[0][0] - two[1][0], two[0][1] - two[1][1]);
    if (apart) { zoom *= now / apart; later(); }
    apart = now;
  });
  canvas.addEventListener("wheel", function (event) {
    if (document.activeElement !== canvas && !event.ctrlKey) { return; }  // the page scrolls until the panel is clicked
    event.preventDefault();
    zoom *= Math.exp(-0.0015 * event.deltaY);
    later();
  }, { passive: false });
  canvas.addEventListener("keydown", function (event) {
    var way = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] }[event.key];
    if (way) { event.preventDefault(); turn(way[0], way[1]); }
    if (event.key === "+" || event.key === "-") { zoom *= event.key === "+" ? 1.25 : 0.8; later(); }
  });
  canvas.addEventListener("webglcontextlost", function () {
    root.querySelector(".live").hidden = true; root.querySelector(".missing").hidden = false;
  });
  new ResizeObserver(later).observe(box);
  legend();
  draw();
  return true;
}
