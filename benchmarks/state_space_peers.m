% Octave's n4sid on the records of state_space_peers.py, in the working directory.
pkg load control
files = glob("record_?_*.mat");
for k = 1:numel(files)
  record = load(files{k});
  kept = double(record.kept);
  data = iddata(record.y(1:kept, :) - mean(record.y(1:kept, :)), record.u(1:kept, :), 0.01);
  begun = cputime();
  [system, x0, info] = n4sid(data, double(record.order));
  seconds = cputime() - begun;
  [A, B, C, D] = ssdata(system);
  K = info.K;
  save("-v6", strrep(files{k}, "record", "Octave n4sid"), "A", "B", "C", "D", "K", "seconds");
end
